// Physics of the simulation: sliders for latents, effects from the library.

import type { Schema } from "../../api/client";
import { uniqueId, h, put } from "../../dom";
import { short, slider } from "../../parts/slider";
import type { Scene } from "../../scene/types";
import { withHelp } from "./help";
import { isEmpirical, superscripts } from "./sceneEffects";

export type Latents = { density?: number; friction?: number; restitution?: number };
export type EffectTerm = { name: string; parameters: Record<string, number> };

/** Ranges, units and help of the sliders. */
const SLIDERS: Record<keyof Latents, [number, number, string, string]> = {
  density: [0.05, 4, "kg/m²", "Mass of a body per area. It changes collisions between bodies, not free fall."],
  friction: [0, 1.5, "", "Coefficient of a body's surface: at 0 it slides freely."],
  restitution: [0, 1, "", "Speed after a bounce over speed before: at 0 nothing bounces."],
};
/** Where effects act, in the order of the list. */
const ACTS_ON: Record<string, string> = {
  motion: "Forces on moving bodies",
  contact: "Contacts",
  body: "Bodies",
  region: "Regions",
  sensor: "Measurement",
  action: "Action",
};

/** Sliders of the latents; `onChange` gets those that were given or changed. */
export function latents(scene: Scene, given: Latents, onChange: (latents: Latents) => void): HTMLElement {
  const now: Latents = { ...given };
  const carrier = scene.bodies.find((b) => !scene.carriers || scene.carriers.includes(b.name));
  const rows = (Object.keys(SLIDERS) as (keyof Latents)[]).map((name) => {
    const [low, high, unit, about] = SLIDERS[name];
    const carrierValue = carrier?.[name];
    const start = now[name] ?? (typeof carrierValue === "number" ? carrierValue : name === "density" ? 1 : 0.5);
    const text = (share: number): string => short(low + share * (high - low), unit);
    const field = slider(name, (start - low) / (high - low), text, (share) => {
      now[name] = low + share * (high - low);
      onChange({ ...now });
    });
    return withHelp(field.element, about);
  });
  return h("div", { class: "stack" }, ...rows);
}

/** Effects from the library, but for empirical terms; `onChange` gets the added ones with their parameters. */
export function effects(library: Schema<"EffectOut">[], onChange: (terms: EffectTerm[]) => void): HTMLElement {
  const terms = new Map<EffectTerm, HTMLElement>();
  const list = h("div", { class: "stack" });
  const id = uniqueId("effect");
  const select = h("select", { id }, ...optionGroups(library.filter((e) => !isEmpirical(e.name))));
  const equation = h("p", { class: "help" });
  const add = h("button", { type: "button" }, "Add");
  const notify = (): void => onChange([...terms.keys()]);
  const about = (): void => void put(equation, superscripts(library.find((e) => e.name === select.value)?.equation ?? ""));
  select.addEventListener("change", about);
  about();
  add.addEventListener("click", () => {
    const effect = library.find((e) => e.name === select.value);
    if (!effect) return;
    const term: EffectTerm = { name: effect.name, parameters: {} };
    const remove = h("button", { type: "button", class: "quiet" }, "Remove");
    const head = h("div", { class: "row between" }, h("strong", {}, effect.name.replaceAll("_", " ")), remove);
    const rows = effect.parameters.map((p, i) => parameter(effect.name, p, i === 0, term, notify));
    const card = h("fieldset", { class: "effect" }, h("legend", { class: "unseen" }, effect.name), head, h("p", { class: "help" }, superscripts(effect.equation)), ...rows);
    remove.addEventListener("click", () => (terms.delete(term), card.remove(), notify()));
    terms.set(term, card);
    list.append(card);
    notify();
  });
  return h("div", { class: "stack" }, h("div", { class: "row" }, h("label", { for: id, class: "unseen" }, "Effect"), select, add), equation, list);
}

function optionGroups(library: Schema<"EffectOut">[]): HTMLElement[] {
  const kinds = [...new Set([...Object.keys(ACTS_ON), ...library.map((e) => e.acts_on)])].filter((kind) => library.some((e) => e.acts_on === kind));
  const options = (kind: string): HTMLElement[] => library.filter((e) => e.acts_on === kind).map((e) => h("option", { value: e.name }, e.name.replaceAll("_", " ")));
  return kinds.map((kind) => h("optgroup", { label: ACTS_ON[kind] ?? kind }, ...options(kind)));
}

/** A slider on a cubic scale: fine near the neutral value, with both bounds at its ends. */
function parameter(effect: string, p: Schema<"EffectParameterOut">, first: boolean, term: EffectTerm, notify: () => void): HTMLElement {
  const [low = 0, high = 1] = p.bounds;
  const of = (share: number): number => {
    const s = 2 * share - 1;
    return p.neutral + Math.abs(s) ** 3 * (s < 0 ? p.neutral - low : high - p.neutral) * Math.sign(s);
  };
  // A new effect starts with a visible value.
  const start = first ? (high > p.neutral ? 0.6 : 0.4) : 0.5;
  term.parameters[p.name] = of(start);
  return slider(`${effect.replaceAll("_", " ")} ${p.name}`, start, (share) => short(of(share), p.unit === "1" ? "" : superscripts(p.unit)), (share) => {
    term.parameters[p.name] = of(share);
    notify();
  }).element;
}
