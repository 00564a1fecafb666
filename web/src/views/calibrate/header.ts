// The header of an estimation: description, progress, interactions spent, actions.

import { api, ok } from "../../api/client";
import { hasEnded } from "../../api/jobState";
import { uniqueId, h, put } from "../../dom";
import { short } from "../../parts/slider";
import { type Context, link } from "../../view";
import { duration } from "../jobs";
import { type EstimationRequest, requestOf, sceneOfRequest, isAskTell, type Job, maxRounds, type EstimationState } from "./estimation";

export interface EstimationHeader {
  element: HTMLElement;
  onJob: (job: Job) => void;
  onRounds: (now: EstimationState) => void;
}

/** `compare` gets the id of the job to compare with, `null` for none. */
export function estimationHeader(id: string, others: readonly Job[], other: string | null, compare: (id: string | null) => void, context: Context): EstimationHeader {
  const [state, words] = [h("span", { class: "state" }), h("p", { class: "soft" })];
  const bar = h("progress", { max: 1, value: 0, "aria-label": `Progress of ${id}` });
  const spent = h("strong", { class: "count" }, "0");
  const limit = h("span", { class: "soft" });
  const what = h("p", { class: "soft" });
  const why = h("p", { class: "why", hidden: true });
  const cancel = h("button", { type: "button" }, "Cancel");
  cancel.addEventListener("click", () => {
    cancel.disabled = true;
    context.fail(null);
    ok(api.DELETE("/v1/jobs/{id}", { params: { path: { id } } }) as Promise<{ data?: unknown; response: Response }>).catch((e: unknown) => ((cancel.disabled = false), context.fail(e)));
  });
  const startSimilar = h("a", { class: "button", href: link("calibrate", [], { like: id }) }, "Start a similar one");
  const job = h("a", { href: link("jobs", [id]) }, "Job and result");
  const choice = uniqueId("compare");
  const options = others.filter((j) => j.id !== id).map((j) => h("option", { value: j.id, selected: j.id === other }, `${j.id}: ${estimationTitle(j)}`));
  const select = h("select", { id: choice }, h("option", { value: "" }, "nothing"), ...options);
  select.addEventListener("change", () => compare(select.value || null));
  const compareControl = h("span", { class: "row compare" }, h("label", { for: choice }, "Compare with"), select);
  const title = h("h2", {}, id);
  const element = h(
    "section",
    { class: "card stack calibrate-head", "aria-label": "Estimation" },
    h("div", { class: "row between" }, h("div", { class: "row" }, title, state), h("p", { class: "tally", role: "status" }, "Real interactions spent: ", spent, " ", limit)),
    what,
    bar,
    words,
    why,
    h("div", { class: "row between" }, h("div", { class: "row" }, cancel, startSimilar, job), compareControl),
  );
  const onJob = (now: Job): void => {
    put(state, now.state);
    state.className = `state ${now.state}`;
    put(what, description(now));
    const { done, total, stage, eta_s: left } = now.progress;
    bar.hidden = hasEnded(now) || total === 0;
    [bar.max, bar.value] = [Math.max(1, total), done];
    const parts = hasEnded(now) ? [stopReason(now)] : [stage || now.state, total > 0 ? `${done} of ${total}` : "", typeof left === "number" ? `${duration(left)} left` : ""];
    put(words, parts.filter(Boolean).join(", "));
    words.hidden = !words.textContent;
    cancel.hidden = hasEnded(now);
    why.hidden = now.state !== "failed";
    put(why, now.error?.detail ?? "");
  };
  const onRounds = (now: EstimationState): void => {
    put(spent, now.interactions);
    const { actions = 10, budget } = requestOf(now.job);
    const bound = Math.min(maxRounds(now.job) * (actions ?? 10), budget ?? Infinity);
    put(limit, hasEnded(now.job) ? "" : `of at most ${bound}`);
  };
  return { element, onJob: onJob, onRounds: onRounds };
}

/** Short description that distinguishes an estimation from others. */
export function estimationTitle(job: Job): string {
  const request = requestOf(job);
  const { strategy, seed, world } = request;
  return [subjectName(request), world ?? (isAskTell(job) ? "rig" : null), strategy ?? "mixed", `seed ${seed ?? 0}`].filter(Boolean).join(", ");
}

/** The task, or the name of the scene. */
function subjectName(request: EstimationRequest): string {
  return request.task || sceneOfRequest(request)?.name || "a scene";
}

function description(job: Job): string {
  const request = requestOf(job);
  const { strategy, residual, fit, rounds, actions, world, seed } = request;
  const where = isAskTell(job) ? "your own rig" : world ? `the world ${world}` : "a new real world";
  const fitted = fit?.length ? `, also fitting ${fit.join(", ")}` : "";
  return `${subjectName(request)} in ${where}; strategy ${strategy ?? "mixed"}, residual ${residual ?? "trajectory"}${fitted}; up to ${rounds ?? 5} rounds of ${actions ?? 10} actions; seed ${seed ?? 0}.`;
}

/** Reason for the end of an estimation. */
function stopReason(job: Job): string {
  if (job.state === "cancelled") return "Cancelled; measurements and estimates so far are kept.";
  if (job.state !== "succeeded") return "";
  const { stopped, seconds } = (job.result ?? {}) as { stopped?: string; seconds?: number };
  const why = { rounds: "All rounds are done", settled: "The estimate converged", budget: "The budget of real interactions is spent" }[stopped ?? ""] ?? "Ended";
  return `${why}${typeof seconds === "number" ? `, after ${short(seconds, "s")}` : ""}.`;
}
