// The way from trials to an exported world: four steps, with the current one marked.

import { h } from "../dom";
import "./steps.css";

export type StepId = "calibrate" | "diagnose" | "extended" | "export";

/** Target of a step: an address, or an action on this page. */
export type StepTarget = string | (() => void);

const STEPS: readonly (readonly [StepId, string, string])[] = [
  ["calibrate", "Calibrate", "estimate the latents"],
  ["diagnose", "Diagnose", "find missing effects"],
  ["extended", "Extended world", "play, calibrate, plan"],
  ["export", "Export", "scene, Python, curl"],
];

/** The steps; those without a target cannot be opened yet. */
export function steps(current: StepId, targets: Partial<Record<StepId, StepTarget>>): HTMLElement {
  const items = STEPS.map(([id, title, about], i) => {
    const isCurrent = id === current;
    const label = [h("span", { class: "step-number", "aria-hidden": "true" }, i + 1), h("span", {}, h("strong", {}, title), h("span", { class: "soft step-about" }, about))];
    return h("li", { "aria-current": isCurrent ? "step" : null, "data-step": id }, stepElement(isCurrent ? undefined : targets[id], label));
  });
  return h("nav", { class: "steps", "aria-label": "Steps" }, h("ol", {}, ...items));
}

function stepElement(target: StepTarget | undefined, label: HTMLElement[]): HTMLElement {
  if (typeof target === "string") return h("a", { class: "step", href: target }, ...label);
  if (!target) return h("span", { class: "step" }, ...label);
  const button = h("button", { type: "button", class: "step" }, ...label);
  button.addEventListener("click", target);
  return button;
}
