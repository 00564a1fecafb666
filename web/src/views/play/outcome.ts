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
  const sentence = h("span", { class: "soft" });
  const verdicts = h("div", { class: "row verdicts", role: "status" });
  const goal = scene.goal ? [h("strong", {}, "Goal: "), goalWords(scene.goal), ". "] : [h("span", { class: "soft" }, "No goal: the film runs to the end of the scene. ")];
  return {
    element: h("div", { class: "goal-row" }, h("p", {}, ...goal, sentence), verdicts),
    show: (simulated, real) => {
      put(sentence, scene.goal ? [clause("The simulation", simulated), clause("Reality", real)].filter(Boolean).join(" ") : null);
      put(verdicts, badge("Simulation", "sim", simulated), badge("Reality", "real", real));
    },
  };
}

function clause(who: string, { film, solved, reached }: Outcome): string {
  if (!film || solved === null) return "";
  if (!solved) return `${who} does not reach it in ${filmLength(film).toFixed(1)} s.`;
  return reached === null ? "" : `${who} reaches it at ${reached.toFixed(2)} s.`;
}

function badge(name: string, which: string, { film, solved }: Outcome): HTMLElement | null {
  if (!film) return null;
  const verdict = solved === null ? "no goal" : solved ? "solved" : "not solved";
  return h("span", { class: `badge ${which}`, "data-verdict": verdict }, `${name}: ${verdict}`);
}
