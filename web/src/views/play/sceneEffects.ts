// Effects that a scene has, as switches.

import type { Schema } from "../../api/client";
import { h } from "../../dom";
import type { Scene } from "../../scene/types";

/** Terms of empirical force fields and formulas, which a diagnosis writes; they are switched together and never added by hand. */
const FIELD_TERMS: readonly string[] = ["place_push", "velocity_push", "clock_push", "place_drive"];
const FORMULA_TERMS: readonly string[] = ["monomial"];

type Library = readonly Schema<"EffectOut">[];

/** An effect of a scene. */
export interface SceneEffect {
  title: string;
  /** Equation and values. */
  detail: string;
  /** Indices in `scene.effects`, or the field that is shorthand for the effect. */
  source: readonly number[] | "damping" | "restitution_threshold";
}

/** Whether an effect is a term of an empirical force field or formula. */
export function isEmpirical(name: string): boolean {
  return FIELD_TERMS.includes(name) || FORMULA_TERMS.includes(name);
}

/** The effects of a scene, shorthand included. */
export function sceneEffects(scene: Scene, library: Library): SceneEffect[] {
  const terms = scene.effects ?? [];
  const of = (name: string, parameters: Record<string, number>, source: SceneEffect["source"]): SceneEffect => ({ title: title(name), detail: detail(name, parameters, library), source });
  const named = terms.flatMap(({ name, parameters = {} }, i) => (isEmpirical(name) ? [] : [of(name, parameters, [i])]));
  const group = (heading: string, about: string, names: readonly string[]): SceneEffect[] => {
    const indices = terms.flatMap(({ name }, i) => (names.includes(name) ? [i] : []));
    return indices.length ? [{ title: heading, detail: `${about} (${indices.length} ${indices.length === 1 ? "term" : "terms"})`, source: indices }] : [];
  };
  const damping = scene.damping !== undefined && scene.damping > 0 && scene.damping < 1 ? [of("linear_drag", { c: -Math.log(scene.damping) }, "damping")] : [];
  const threshold = scene.contact_rules?.restitution_threshold ? [of("restitution_threshold", { speed: scene.contact_rules.restitution_threshold }, "restitution_threshold")] : [];
  return [
    ...named,
    ...damping,
    ...threshold,
    ...group("empirical force field", "a force that no effect of the library explains, as a smooth field", FIELD_TERMS),
    ...group("empirical law", "a force that no effect of the library explains, as a formula", FORMULA_TERMS),
  ];
}

/** The scene without some of its effects; the scene itself if there are none. */
export function sceneWithout(scene: Scene, off: readonly SceneEffect[]): Scene {
  if (!off.length) return scene;
  const copy = structuredClone(scene);
  const removed = new Set(off.flatMap((e) => (typeof e.source === "string" ? [] : e.source)));
  if (copy.effects) copy.effects = copy.effects.filter((_, i) => !removed.has(i));
  if (off.some((e) => e.source === "damping")) delete copy.damping;
  if (copy.contact_rules && off.some((e) => e.source === "restitution_threshold")) copy.contact_rules.restitution_threshold = 0;
  return copy;
}

/** A switch for each effect; `onChange` gets those that are off. */
export function effectSwitches(effects: readonly SceneEffect[], onChange: (off: SceneEffect[]) => void): HTMLElement {
  if (!effects.length) return h("p", { class: "help" }, "The scene has none: bodies move by gravity and contacts alone. Add one below to see what it does.");
  const off = new Set<SceneEffect>();
  const rows = effects.map((effect) => {
    const input = h("input", { type: "checkbox", role: "switch", checked: true });
    input.addEventListener("change", () => {
      if (input.checked) off.delete(effect);
      else off.add(effect);
      onChange(effects.filter((e) => off.has(e)));
    });
    return h("label", { class: "switch" }, input, h("span", {}, h("strong", {}, effect.title), " ", h("span", { class: "soft" }, effect.detail)));
  });
  return h("div", { class: "stack", role: "group", "aria-label": "Effects of the scene" }, ...rows);
}

function title(name: string): string {
  return name.replaceAll("_", " ");
}

/** Powers as superscripts: "m/s^2" is "m/s²". */
export function superscripts(text: string): string {
  return text.replace(/\^([23])(?![\d.])/g, (_, digit: string) => (digit === "2" ? "²" : "³"));
}

/** "a = -c v; c = 0.8 1/s". */
function detail(name: string, parameters: Record<string, number>, library: Library): string {
  const effect = library.find((e) => e.name === name);
  const units = new Map(effect?.parameters.map((p) => [p.name, p.unit === "1" ? "" : p.unit]));
  const values = Object.entries(parameters).map(([key, value]) => `${key} = ${Number(value.toPrecision(3))} ${units.get(key) ?? ""}`.trim());
  return superscripts([effect?.equation ?? "", values.join(", ")].filter(Boolean).join("; "));
}
