// Physics of the simulation: sliders for latents, effects from the library.

import type { Schema } from "../../api/client";
import { uniqueId, h, put } from "../../dom";
import { short, slider } from "../../parts/slider";
import type { Scene } from "../../scene/types";

export type Latents = { density?: number; friction?: number; restitution?: number };
export type EffectTerm = { name: string; parameters: Record<string, number> };

/** Ranges of the sliders. */
const SLIDER_RANGES: Record<keyof Latents, [number, number, string]> = {
  density: [0.05, 4, "kg/m²"],
  friction: [0, 1.5, ""],
  restitution: [0, 1, ""],
};

/** Sliders of the latents; `onChange` gets those that were given or changed. */
export function latents(scene: Scene, given: Latents, onChange: (latents: Latents) => void): HTMLElement {
  const now: Latents = { ...given };
  const carrier = scene.bodies.find((b) => !scene.carriers || scene.carriers.includes(b.name));
  const rows = (Object.keys(SLIDER_RANGES) as (keyof Latents)[]).map((name) => {
    const [low, high, unit] = SLIDER_RANGES[name];
    const carrierValue = carrier?.[name];
    const start = now[name] ?? (typeof carrierValue === "number" ? carrierValue : name === "density" ? 1 : 0.5);
    const text = (share: number): string => short(low + share * (high - low), unit);
    return slider(name, (start - low) / (high - low), text, (share) => {
      now[name] = low + share * (high - low);
      onChange({ ...now });
    }).element;
  });
  return h("div", { class: "stack" }, ...rows);
}

/** Effects from the library; `onChange` gets the added ones with their parameters. */
export function effects(library: Schema<"EffectOut">[], onChange: (terms: EffectTerm[]) => void): HTMLElement {
  const terms = new Map<EffectTerm, HTMLElement>();
  const list = h("div", { class: "stack" });
  const id = uniqueId("effect");
  const options = library.map((e) => h("option", { value: e.name }, e.name.replaceAll("_", " ")));
  const select = h("select", { id }, ...options);
  const equation = h("p", { class: "soft" });
  const add = h("button", { type: "button" }, "Add");
  const notify = (): void => onChange([...terms.keys()]);
  const about = (): void => void put(equation, library.find((e) => e.name === select.value)?.equation);
  select.addEventListener("change", about);
  about();
  add.addEventListener("click", () => {
    const effect = library.find((e) => e.name === select.value);
    if (!effect) return;
    const term: EffectTerm = { name: effect.name, parameters: {} };
    const remove = h("button", { type: "button", class: "quiet" }, "Remove");
    const head = h("div", { class: "row between" }, h("strong", {}, effect.name.replaceAll("_", " ")), remove);
    const rows = effect.parameters.map((p, i) => parameter(effect.name, p, i === 0, term, notify));
    const card = h("fieldset", { class: "effect" }, h("legend", { class: "unseen" }, effect.name), head, h("p", { class: "soft" }, effect.equation), ...rows);
    remove.addEventListener("click", () => (terms.delete(term), card.remove(), notify()));
    terms.set(term, card);
    list.append(card);
    notify();
  });
  return h("div", { class: "stack" }, h("div", { class: "row" }, h("label", { for: id, class: "unseen" }, "Effect"), select, add), equation, list);
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
  return slider(`${effect.replaceAll("_", " ")} ${p.name}`, start, (share) => short(of(share), p.unit), (share) => {
    term.parameters[p.name] = of(share);
    notify();
  }).element;
}
