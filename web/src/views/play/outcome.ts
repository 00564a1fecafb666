// The goal in words, and whether and when films reach it.

import { h, put } from "../../dom";
import { filmLength, type Film } from "../../scene/film";
import { goalWords } from "../../scene/goal";
import type { Scene } from "../../scene/types";

/** Outcome of a film. */
export interface Outcome {
  film: Film | null;
  /** `null` without a goal. */
  solved: boolean | null;
  /** Time at which the goal is reached, s; `null` if it is not, or not known yet. */
  reached: number | null;
}

/** The goal of a scene above its picture; `show` gets the outcomes. */
export function outcomeRow(scene: Scene): { element: HTMLElement; show: (simulated: Outcome, real: Outcome) => void } {
  const verdicts = h("div", { class: "row verdicts", role: "status" });
  const goal = scene.goal ? [h("strong", {}, "Goal: "), `${goalWords(scene.goal)}.`] : [h("span", { class: "soft" }, "The scene has no goal: its film runs to the end.")];
  return {
    element: h("div", { class: "goal-row" }, h("p", {}, ...goal), verdicts),
    show: (simulated, real) => void put(verdicts, ...badge("Simulation", "sim", simulated), ...badge("Reality", "real", real)),
  };
}

/** A verdict, and when: "Simulation: solved" "at 6.20 s". */
function badge(name: string, which: string, { film, solved, reached }: Outcome): HTMLElement[] {
  if (!film) return [];
  const verdict = solved === null ? "no goal" : solved ? "solved" : "not solved";
  const time = solved === false ? `in ${filmLength(film).toFixed(1)} s` : reached === null ? "" : `at ${reached.toFixed(2)} s`;
  return [h("span", { class: `badge ${which}`, "data-verdict": verdict }, `${name}: ${verdict}`), h("span", { class: "when soft" }, time)];
}
