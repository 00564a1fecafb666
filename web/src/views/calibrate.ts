// Calibrate: estimations of latents, started and followed. `#/calibrate` starts one, `#/calibrate/job-3` shows one,
// `?with=job-2` compares it with another.

import { api, ok } from "../api/client";
import { h, put } from "../dom";
import { type Context, link, type View } from "../view";
import { startForm, loadChoices } from "./calibrate/startForm";
import { type EstimationRequest, requestOf, estimation, followEstimation, isAskTell, type Job, type EstimationState } from "./calibrate/estimation";
import { findings } from "./calibrate/findings";
import { estimationHeader, estimationTitle } from "./calibrate/header";
import { roundsView } from "./calibrate/rounds";
import { askTellView } from "./calibrate/askTell";
import { worstTrials } from "./calibrate/worstTrials";
import "./calibrate.css";

export const calibrate: View = {
  id: "calibrate",
  title: "Calibrate",
  about: "Estimate the latents of a real world from few real interactions.",
  open: (place, context) => (context.rest[0] ? estimationView(place, context.rest[0], context) : start(place, context)),
};

/** Maximum number of estimations read, newest first. */
const MAX_READ = 100;
/** Maximum number of estimations listed. */
const MAX_LISTED = 12;

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const template = context.query.get("like");
  const [of, runs, before] = await Promise.all([loadChoices(signal), estimations(signal), template ? loadRequest(template, signal) : {}]);
  const form = startForm(of, before, (job) => (location.hash = link("calibrate", [job.id])), context);
  const rows = runs.slice(0, MAX_LISTED).map((job) => h("li", {}, h("a", { href: link("calibrate", [job.id]) }, job.id), h("span", {}, estimationTitle(job)), h("span", { class: `state ${job.state}` }, job.state)));
  const list = rows.length ? h("ul", { class: "runs" }, ...rows) : h("p", { class: "soft" }, "None yet.");
  put(place, h("div", { class: "calibrate-start" }, form, h("section", { class: "card stack", "aria-label": "Estimations" }, h("h2", {}, "Estimations"), list, runs.length > MAX_LISTED ? h("p", { class: "soft" }, "Older ones: ", h("a", { href: link("jobs") }, "Jobs"), ".") : null)));
}

/** Estimations, newest first. */
async function estimations(signal: AbortSignal): Promise<Job[]> {
  const { jobs } = await ok(api.GET("/v1/jobs", { params: { query: { kind: "iplw", order: "newest", results: false, limit: MAX_READ } }, signal }));
  return jobs;
}

async function loadRequest(id: string, signal: AbortSignal): Promise<EstimationRequest> {
  return requestOf(await estimation(id, signal));
}

async function estimationView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const job = await estimation(id, signal);
  const [runs, units] = await Promise.all([estimations(signal), unitsOf(job, signal)]);
  const [findingsView, rounds, trials, askTell] = [findings(units), roundsView(context), worstTrials(context), isAskTell(job) ? askTellView(id, context) : null];
  let [current, other]: [EstimationState | null, EstimationState | null] = [null, null];
  let comparison = new AbortController();
  const show = (): void => {
    if (current) findingsView.show(current, other);
  };
  const compare = (otherId: string | null): void => {
    comparison.abort();
    comparison = new AbortController();
    other = null;
    history.replaceState(null, "", link("calibrate", [id], otherId ? { with: otherId } : {}));
    show();
    if (!otherId) return;
    const both = AbortSignal.any([signal, comparison.signal]);
    followEstimation(otherId, () => undefined, (standing) => both.aborted || ((other = standing), show()), both, context.fail).catch((e: unknown) => both.aborted || context.fail(e));
  };
  const comparedId = context.query.get("with");
  const top = estimationHeader(id, runs, comparedId, compare, context);
  put(place, h("div", { class: "calibrate" }, h("p", {}, h("a", { href: link("calibrate") }, "All estimations")), top.element, askTell?.element, findingsView.element, rounds.element, trials.element));
  if (comparedId) compare(comparedId);
  let state = job.state;
  const onJob = (next: Job): void => {
    top.onJob(next);
    if (next.state !== state) context.say(`${id} is ${next.state}.`);
    state = next.state;
  };
  await followEstimation(
    id,
    onJob,
    (standing) => {
      current = standing;
      for (const part of [rounds, trials, askTell, { show: top.onRounds }]) part?.show(standing);
      show();
    },
    signal,
    context.fail,
  );
}

/** Units of the effect parameters that are fitted as well. */
async function unitsOf(job: Job, signal: AbortSignal): Promise<Map<string, string>> {
  if (!requestOf(job).fit?.length) return new Map();
  const { effects } = await ok(api.GET("/v1/effects", { params: { query: { limit: 1000 } }, signal }));
  return new Map(effects.flatMap((e) => e.parameters.map((p) => [`${e.name}.${p.name}`, p.unit] as const)));
}
