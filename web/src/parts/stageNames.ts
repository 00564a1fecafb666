// The stages of a job by their names, as its events report them.

import type { Schema } from "../api/client";
import { hasEnded } from "../api/jobState";
import { h, put } from "../dom";
import { duration } from "./time";

type Job = Schema<"JobOut">;

/** The stages of a job so far. */
export interface StageList {
  element: HTMLElement;
  /** Displays the stages of the job's progress. */
  update: (job: Job) => void;
  /** When the job started, Unix s; `null` while it is queued. Without this, the elapsed time is not displayed. */
  start?: () => number | null;
}

/** The names of the stages, and how far the current one is. */
export function stageNames(): StageList {
  const [words, list] = [h("p", { class: "soft" }), h("ol", { class: "stage-names" })];
  const names: string[] = [];
  const update = (job: Job): void => {
    const { stage, done, total, eta_s: remaining } = job.progress;
    words.hidden = hasEnded(job);
    put(words, [total > 0 ? `${done} of ${total}` : "", typeof remaining === "number" ? `about ${duration(remaining)} more for this stage` : ""].filter(Boolean).join(", "));
    if (stage && names.at(-1) !== stage) names.push(stage);
    put(list, ...names.map((name, i) => h("li", { "aria-current": i === names.length - 1 && !hasEnded(job) ? "step" : null }, name)));
  };
  return { element: h("div", { class: "stack" }, words, list), update };
}
