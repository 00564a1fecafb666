// Calibrate: estimations of latents, started and followed. `#/calibrate` starts one, `#/calibrate/job-3` shows one,
// `?with=job-2` lays another one over it.

import { api, ok } from "../api/client";
import { h, put } from "../dom";
import { type Context, link, type View } from "../view";
import { begin, choices } from "./calibrate/begin";
import { type Asked, asked, estimation, followed, isRig, type Job, type Standing } from "./calibrate/course";
import { findings } from "./calibrate/findings";
import { head, titled } from "./calibrate/head";
import { proposed } from "./calibrate/proposed";
import { rig } from "./calibrate/rig";
import { worst } from "./calibrate/worst";
import "./calibrate.css";

export const calibrate: View = {
  id: "calibrate",
  title: "Calibrate",
  about: "Find the latents of a real world with few real interactions, and see how well they are known.",
  open: (place, context) => (context.rest[0] ? one(place, context.rest[0], context) : start(place, context)),
};

/** Newest estimations that are looked at. */
const JOBS = 100;
/** Estimations that are listed. */
const LISTED = 12;

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const like = context.query.get("like");
  const [of, runs, before] = await Promise.all([choices(signal), estimations(signal), like ? request(like, signal) : {}]);
  const form = begin(of, before, (job) => (location.hash = link("calibrate", [job.id])), context);
  const rows = runs.slice(0, LISTED).map((job) => h("li", {}, h("a", { href: link("calibrate", [job.id]) }, job.id), h("span", {}, titled(job)), h("span", { class: `state ${job.state}` }, job.state)));
  const list = rows.length ? h("ul", { class: "runs" }, ...rows) : h("p", { class: "soft" }, "There are none yet.");
  put(place, h("div", { class: "calibrate-start" }, form, h("section", { class: "card stack", "aria-label": "Estimations" }, h("h2", {}, "Estimations"), list, runs.length > LISTED ? h("p", { class: "soft" }, "Older ones are under ", h("a", { href: link("jobs") }, "Jobs"), ".") : null)));
}

/** Estimations, newest first. */
async function estimations(signal: AbortSignal): Promise<Job[]> {
  const { jobs } = await ok(api.GET("/v1/jobs", { params: { query: { kind: "iplw", order: "newest", results: false, limit: JOBS } }, signal }));
  return jobs;
}

async function request(id: string, signal: AbortSignal): Promise<Asked> {
  return asked(await estimation(id, signal));
}

async function one(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const job = await estimation(id, signal);
  const [runs, units] = await Promise.all([estimations(signal), unitsOf(job, signal)]);
  const [found, rounds, trials, asks] = [findings(units), proposed(context), worst(context), isRig(job) ? rig(id, context) : null];
  let [now, other]: [Standing | null, Standing | null] = [null, null];
  let beside = new AbortController();
  const show = (): void => {
    if (now) found.show(now, other);
  };
  const compare = (wanted: string | null): void => {
    beside.abort();
    beside = new AbortController();
    other = null;
    history.replaceState(null, "", link("calibrate", [id], wanted ? { with: wanted } : {}));
    show();
    if (!wanted) return;
    const both = AbortSignal.any([signal, beside.signal]);
    followed(wanted, () => undefined, (standing) => both.aborted || ((other = standing), show()), both, context.fail).catch((e: unknown) => both.aborted || context.fail(e));
  };
  const with_ = context.query.get("with");
  const top = head(id, runs, with_, compare, context);
  put(place, h("div", { class: "calibrate" }, h("p", {}, h("a", { href: link("calibrate") }, "All estimations, and a new one")), top.element, asks?.element, found.element, rounds.element, trials.element));
  if (with_) compare(with_);
  let state = job.state;
  const moved = (next: Job): void => {
    top.moved(next);
    if (next.state !== state) context.say(`${id} is ${next.state}.`);
    state = next.state;
  };
  await followed(
    id,
    moved,
    (standing) => {
      now = standing;
      for (const part of [rounds, trials, asks, { show: top.stands }]) part?.show(standing);
      show();
    },
    signal,
    context.fail,
  );
}

/** Units of the parameters that are fitted along. */
async function unitsOf(job: Job, signal: AbortSignal): Promise<Map<string, string>> {
  if (!asked(job).fit?.length) return new Map();
  const { effects } = await ok(api.GET("/v1/effects", { params: { query: { limit: 1000 } }, signal }));
  return new Map(effects.flatMap((e) => e.parameters.map((p) => [`${e.name}.${p.name}`, p.unit] as const)));
}
