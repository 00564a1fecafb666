// How well a model reproduces trials, in words and colour: its error beside the measurement noise.

import { h } from "../dom";
import "./fitQuality.css";

/** `open`: too few trials for a judgement. */
export type FitLevel = "good" | "warn" | "bad" | "open";

export interface FitJudgement {
  level: FitLevel;
  text: string;
}

/** Ratio of error and noise up to which a model explains the trials, and above which it is far off. */
const [MAX_GOOD_RATIO, MAX_WARN_RATIO] = [1.2, 3];

/** Judges an error, m, beside the noise, m. `adequate`: result of a test for lack of fit, if there was one. */
export function judgeFit(model: string, error: number, noise: number, adequate: boolean | null = null): FitJudgement {
  const ratio = noise > 0 ? error / noise : Infinity;
  const sizes = `${length(error)} beside ${length(noise)} of noise`;
  if (adequate ?? ratio <= MAX_GOOD_RATIO) return { level: "good", text: `${model} explains the trials down to the noise: error ${sizes}` };
  return { level: ratio <= MAX_WARN_RATIO ? "warn" : "bad", text: `${model} does not fit: error ${times(ratio)} the noise (${sizes})` };
}

/** A judgement as a line with a mark, which does not depend on colour alone. */
export function fitLine(judgement: FitJudgement): HTMLElement {
  const { level, text } = judgement;
  const mark = { good: "✓", warn: "!", bad: "✗", open: "?" }[level];
  return h("p", { class: `fit-line ${level}`, "data-fit": level }, h("span", { class: "fit-mark", "aria-hidden": "true" }, mark), h("span", {}, text));
}

/** A length with two significant digits and a readable unit. */
export function length(metres: number): string {
  const size = Math.abs(metres);
  if (size < 1e-7) return "under 0.1 µm";
  const [value, unit] = size >= 1 ? [metres, "m"] : size >= 0.1 ? [metres * 1e2, "cm"] : size >= 1e-4 ? [metres * 1e3, "mm"] : [metres * 1e6, "µm"];
  return `${Number(value.toPrecision(2))} ${unit}`;
}

function times(ratio: number): string {
  return Number.isFinite(ratio) ? `${ratio < 10 ? ratio.toFixed(1) : Math.round(ratio)} times` : "far above";
}
