// Progress of a training: loss and validation AUCCESS as curves, and the result.

import { api, ok, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { hasEnded } from "../../api/jobState";
import { h, put } from "../../dom";
import { curvePlot, type CurveSeries } from "../../parts/curvePlot";
import { short } from "../../parts/slider";
import { duration } from "../jobs";
import type { Context } from "../../view";
import { means, movingAverage } from "./scores";

type Job = Schema<"JobOut">;
type Point = { at: number; value: number };

/** Curves by name. */
export type Curves = Record<"loss" | "validation", Point[]>;

/** The loss is averaged over this fraction of its points. */
const SMOOTHING_PARTS = 15;
/** Maximum number of points of the loss; the server reports as many. */
const MAX_LOSS_POINTS = 200;

/** Adds an event to the curves; a restarted training starts with empty curves. */
export function updateCurves(before: Curves, job: Job): Curves {
  if (job.state === "succeeded" && job.result) {
    const result = job.result as unknown as TrainingResult;
    const checks = (result.validation ?? []).map((c) => ({ at: c.batches, value: c.auccess }));
    return { loss: means(result.loss, MAX_LOSS_POINTS), validation: checks };
  }
  // Queued or still labelling: earlier points belong to a run interrupted by a restart of the server.
  if (job.state === "queued" || (job.state === "running" && job.progress.stage !== "train")) return { loss: [], validation: [] };
  const now: Curves = { loss: [...before.loss], validation: [...before.validation] };
  for (const { name, at, value } of job.progress.figures ?? []) {
    if (name === "loss" || name === "validation") now[name].push({ at, value });
  }
  return now;
}

/** Displays a training or learning job; `onEnded` gets the policy, if there is one. */
export function trainingProgress(job: Job, onEnded: (policy: string | null) => void, context: Context): HTMLElement {
  const state = h("span", { class: "state" });
  const bar = h("progress", { "aria-label": `Progress of ${job.id}` });
  const words = h("span", { class: "soft" });
  const errorText = h("p", { class: "why" });
  const cancel = h("button", { type: "button" }, "Cancel");
  const outcome = h("p", { role: "status" });
  const loss = curvePlot({ about: "Loss over updates", x: "updates", y: "loss, nats" });
  const validation = curvePlot({ about: "AUCCESS on validation tasks over updates", x: "updates", y: "validation AUCCESS", most: 1, marked: true });
  const checks = h("figure", { hidden: true }, h("figcaption", { class: "soft" }, "Validation AUCCESS, in simulation"), validation.svg);
  const lossFigure = h("figure", {}, h("figcaption", { class: "soft" }, "Loss; 0.69 is chance level"), loss.svg);
  let curves: Curves = { loss: [], validation: [] };
  const show = (now: Job): void => {
    curves = updateCurves(curves, now);
    const { done, total, stage, eta_s: left } = now.progress;
    const ended = hasEnded(now);
    state.className = `state ${now.state}`;
    put(state, now.state);
    [bar.hidden, cancel.hidden] = [ended || !total, ended];
    [bar.max, bar.value] = [Math.max(1, total), done];
    put(words, ended ? null : [STAGES[stage] ?? stage, total ? `${done} of ${total}` : "", typeof left === "number" ? `${duration(left)} left` : ""].filter(Boolean).join(", "));
    put(errorText, now.error?.detail);
    const last = (now.config as { batches?: number }).batches ?? (stage === "train" ? total : 1);
    loss.draw(series("loss", 1, curves.loss).flatMap((raw) => [{ ...raw, faint: true }, mean(raw)]), last);
    validation.draw(series("validation AUCCESS", 3, curves.validation), last);
    checks.hidden = !curves.validation.length;
    if (now.state === "succeeded") put(outcome, ...outcomeText(now));
  };
  show(job);
  cancel.addEventListener("click", () => {
    cancel.disabled = true;
    ok(api.DELETE("/v1/jobs/{id}", { params: { path: { id: job.id } } }) as Promise<{ data?: unknown; response: Response }>).catch(context.fail);
  });
  follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => {
    const now = JSON.parse(event.data) as Job;
    show(now);
    if (event.event === "done") onEnded(now.state === "succeeded" ? (now.result as unknown as TrainingResult).policy : null);
  }, context.signal).catch(context.fail);
  const head = h("div", { class: "row" }, h("strong", {}, job.id), state, words, cancel);
  return h("div", { class: "stack", "data-job": job.id }, head, bar, errorText, outcome, h("div", { class: "sides" }, lossFigure, checks));
}

function series(name: string, look: number, points: readonly Point[]): CurveSeries[] {
  return points.length ? [{ name, look, x: points.map((p) => p.at), y: points.map((p) => p.value) }] : [];
}

/** Moving average of a curve. */
function mean(raw: CurveSeries): CurveSeries {
  return { ...raw, name: "mean loss", y: movingAverage(raw.y, Math.max(3, Math.round(raw.y.length / SMOOTHING_PARTS))) };
}

/** Summary of the result. */
function outcomeText(job: Job): (HTMLElement | string)[] {
  const result = job.result as unknown as TrainingResult;
  const from = result.interactions === undefined ? `${result.examples} simulated actions` : `${result.interactions} real attempts`;
  const last = result.validation?.at(-1);
  const checked = last ? `, validation AUCCESS ${short(last.auccess)}` : "";
  return [h("strong", {}, result.policy), `: trained on ${from}, of which ${result.solving} solve the task; loss ${short(means(result.loss, 20).at(-1)?.value ?? 0)} at the end${checked}.`];
}

const STAGES: Record<string, string> = { label: "labelling actions in simulation", train: "learning" };

interface TrainingResult {
  policy: string;
  loss: number[];
  validation?: { batches: number; auccess: number }[];
  examples?: number;
  interactions?: number;
  solving: number;
}
