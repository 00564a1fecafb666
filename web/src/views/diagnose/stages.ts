// Stages of a diagnosis from its log: those that are passed with their duration and findings, and the current one.

import { all, api, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import { latest } from "../../parts/latest";
import type { StageList } from "../../parts/stageNames";
import { duration } from "../../parts/time";
import type { Context } from "../../view";

type Line = Schema<"LogLineOut">;

/** The stages of a diagnosis, in order, with a sentence about each. */
const STAGES: Record<string, string> = {
  "reading the trials": "Columns, units and times of each trial.",
  "segmenting trials": "Trials are cut into segments between contacts.",
  "estimating the noise": "How much repeated positions scatter.",
  "rejecting outliers": "Observations that no motion explains are left out.",
  "fitting the base model": "The scene without further effects, with its best latents and initial states.",
  "trying strong effects": "Effects that may hide all others.",
  "estimating variance components": "How much the trials differ from each other.",
  "trying without trials that are unlike the others": "Whether a few trials decide the result.",
  "trying single effects": "Each effect of the library by itself.",
  "trying pairs of effects": "Two effects together.",
  "trying triples of effects": "Three effects together.",
  "comparing sets of effects": "The probability of each set.",
  "writing the report": "Held-out errors, plots and the next experiment.",
};
/** Lines about the job itself. */
const JOB_LINES = ["queued", "started", "succeeded", "failed", "cancelled"];

/** A stage with the times of its begin and end, Unix s, and what the log says about it. */
export interface Stage {
  name: string;
  begin: number;
  end: number | null;
  findings: string[];
}

/** The stages of a log; other lines are findings of the stage in which they were written. */
export function stagesOf(lines: readonly Line[]): Stage[] {
  const stages: Stage[] = [];
  for (const { at, level, text } of lines) {
    const last = stages.at(-1);
    const isStage = text in STAGES || /^(trying|fitting|checking) /.test(text);
    if (last && (isStage || JOB_LINES.includes(text)) && last.end === null) last.end = at;
    if (isStage) stages.push({ name: text, begin: at, end: null, findings: [] });
    else if (!JOB_LINES.includes(text)) last?.findings.push(level === "info" ? text : `${level}: ${text}`);
  }
  return stages;
}

/** When the job started, Unix s; `null` while it is queued. A restarted job counts from its first start. */
export function startOf(lines: readonly Line[]): number | null {
  return lines.find((l) => l.text === "started")?.at ?? null;
}

/** The stages of a diagnosis; every update reads new lines of its log. */
export function stageList(id: string, context: Context): StageList {
  const element = h("ol", { class: "stages", "aria-label": "Stages" });
  const lines: Line[] = [];
  const update = latest<Schema<"JobOut">>(async (job) => {
    try {
      const after = lines.at(-1)?.number ?? 0;
      lines.push(
        ...(await all(
          (cursor) => ok(api.GET("/v1/jobs/{id}/log", { params: { path: { id }, query: { after, limit: 1000, ...(cursor ? { cursor } : {}) } }, signal: context.signal })),
          (page) => page.lines,
        )),
      );
      put(element, ...stagesOf(lines).map((stage) => item(stage, job)));
    } catch (e) {
      context.fail(e);
    }
  });
  return { element, update, start: () => startOf(lines) };
}

function item(stage: Stage, job: Schema<"JobOut">): HTMLElement {
  const isCurrent = stage.end === null && job.state === "running";
  const { done, total, eta_s: left } = job.progress;
  const share = isCurrent && job.progress.stage === stage.name && total > 1 ? `${done} of ${total}` : "";
  const time = stage.end === null ? (typeof left === "number" && isCurrent ? `about ${duration(left)} left` : "") : seconds(stage.end - stage.begin);
  const name = stage.name.charAt(0).toUpperCase() + stage.name.slice(1);
  return h(
    "li",
    { "aria-current": isCurrent ? "step" : null, class: stage.end === null ? null : "passed" },
    h("span", { class: "stage-line" }, h("span", {}, name), h("span", { class: "soft" }, [share, time].filter(Boolean).join(", "))),
    isCurrent ? h("span", { class: "soft stage-about" }, STAGES[stage.name] ?? null) : null,
    ...stage.findings.map((text) => h("span", { class: "stage-finding" }, text)),
  );
}

/** A duration; empty if too short to matter. */
function seconds(elapsed: number): string {
  if (elapsed < 0.1) return "";
  return elapsed < 10 ? `${elapsed.toFixed(1)} s` : duration(elapsed);
}
