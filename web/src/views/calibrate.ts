// Calibrate: estimations of latents, started and followed. `#/calibrate` starts one, `#/calibrate/job-3` shows one,
// `?with=job-2` compares it with another.
// `#/calibrate?like=job-3&fit=linear_drag.c` fills the form, `#/calibrate?scene=handoff` calibrates a scene of another view.

import { api, ok, type Schema } from "../api/client";
import { effectLibrary, parameterUnits } from "../api/effects";
import { h, put } from "../dom";
import { storedScene } from "../scene/handoff";
import { type Context, link, type View } from "../view";
import { startForm, loadChoices } from "./calibrate/startForm";
import { type EstimationRequest, requestOf, estimation, followEstimation, isAskTell, type Job, type EstimationState, sceneOfRequest } from "./calibrate/estimation";
import { findings } from "./calibrate/findings";
import { estimationHeader, estimationTitle } from "./calibrate/header";
import { nextSteps } from "./calibrate/nextSteps";
import { rememberScene, roundsView } from "./calibrate/rounds";
import { askTellView } from "./calibrate/askTell";
import { worstTrials } from "./calibrate/worstTrials";
import "./calibrate.css";

export const calibrate: View = {
  id: "calibrate",
  title: "Calibrate",
  about: "Estimate density, friction and restitution of a real world from few real interactions.",
  open: (place, context) => (context.rest[0] ? estimationView(place, context.rest[0], context) : start(place, context)),
};

/** Maximum number of estimations read, newest first. */
const MAX_READ = 100;
/** Maximum number of estimations listed. */
const MAX_LISTED = 12;

/** An example that takes seconds: the real world has a drag that the simulation lacks, which a diagnosis then names. */
const EXAMPLE: EstimationRequest = { task: "bowling", rounds: 2, actions: 4, samples: 20, seed: 1 };

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const template = await templateOf(context);
  const scene = context.query.get("scene") === "handoff" ? storedScene() : sceneOfRequest(template);
  const [of, runs] = await Promise.all([loadChoices(scene, signal), estimations(signal)]);
  const open = (job: Job): void => void (location.hash = link("calibrate", [job.id]));
  const form = startForm(of, template, open, context);
  put(place, h("div", { class: "calibrate-start" }, form, estimationList(runs, open, context)));
}

/** Fields of the form that an address may have. */
const ADDRESS_FIELDS = ["task", "strategy", "surface"] as const;

/** The request that fills the form: of the estimation `like`, with the effect parameters `fit` added, and other fields of the
 * address. */
async function templateOf({ query, signal }: Context): Promise<EstimationRequest> {
  const like = query.get("like");
  const request = like ? requestOf(await estimation(like, signal)) : {};
  const fit = (query.get("fit") ?? "").split(",").filter(Boolean);
  const fields = Object.fromEntries(ADDRESS_FIELDS.flatMap((name) => (query.has(name) ? [[name, query.get(name)!]] : [])));
  return { ...request, ...fields, ...(fit.length ? { fit: [...new Set([...(request.fit ?? []), ...fit])] } : {}) };
}

/** Estimations so far, or what an estimation is; with an example. */
function estimationList(runs: readonly Job[], open: (job: Job) => void, context: Context): HTMLElement {
  const rows = runs.slice(0, MAX_LISTED).map((job) => h("li", {}, h("a", { href: link("calibrate", [job.id]) }, job.id), h("span", {}, estimationTitle(job)), h("span", { class: `state ${job.state}` }, job.state)));
  const example = h("button", { type: "button", class: rows.length ? null : "main" }, "Try with bowling, 2 rounds");
  example.addEventListener("click", () => {
    example.disabled = true;
    context.fail(null);
    ok(api.POST("/v1/iplw", { body: EXAMPLE as Schema<"EstimationIn">, signal: context.signal }))
      .then(open)
      .catch((e: unknown) => ((example.disabled = false), context.fail(e)));
  });
  const explanation = h("p", { class: "soft" }, "None yet. An estimation chooses experiments in simulation, makes them in the real world, and fits density, friction and restitution to what it measures; then it says how well the simulation fits.");
  const older = runs.length > MAX_LISTED ? h("p", { class: "soft" }, "Older ones: ", h("a", { href: link("jobs") }, "Jobs"), ".") : null;
  const about = h("p", { class: "soft" }, "8 interactions with a simulated real world; takes a few seconds.");
  return h("section", { class: "card stack", "aria-label": "Estimations" }, h("h2", {}, "Estimations"), rows.length ? h("ul", { class: "runs" }, ...rows) : explanation, older, h("div", { class: "row" }, example), about);
}

/** Estimations, newest first. */
async function estimations(signal: AbortSignal): Promise<Job[]> {
  const { jobs } = await ok(api.GET("/v1/jobs", { params: { query: { kind: "iplw", order: "newest", results: false, limit: MAX_READ } }, signal }));
  return jobs;
}

async function estimationView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const job = await estimation(id, signal);
  const scene = sceneOfRequest(requestOf(job));
  if (scene) rememberScene(scene);
  const [runs, units] = await Promise.all([estimations(signal), unitsOf(job, signal)]);
  const [findingsView, next, rounds, trials, askTell] = [findings(units), nextSteps(id, context), roundsView(context), worstTrials(context), isAskTell(job) ? askTellView(id, context) : null];
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
  put(place, h("div", { class: "calibrate" }, h("p", {}, h("a", { href: link("calibrate") }, "All estimations")), top.element, next.element, askTell?.element, findingsView.element, rounds.element, trials.element));
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
      for (const part of [next, rounds, trials, askTell, { show: top.onRounds }]) part?.show(standing);
      show();
    },
    signal,
    context.fail,
  );
}

/** Units of the effect parameters that are fitted as well. */
async function unitsOf(job: Job, signal: AbortSignal): Promise<Map<string, string>> {
  if (!requestOf(job).fit?.length) return new Map();
  return parameterUnits(await effectLibrary(signal));
}
