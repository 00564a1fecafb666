// Two jobs beside each other: results in phrases, curves over each other, differing settings.

import { type Child, h, put } from "../../dom";
import { follow } from "../../api/events";
import { hasEnded } from "../../api/jobState";
import { type Context, link } from "../../view";
import { comparedCurves } from "./compareCurves";
import { differences, flatten, type Setting } from "./flatten";
import { type Job, kindOf, readJob, subjectOf, titleOf, viewOf } from "./job";
import { resultScalars } from "./result";
import { resultOf, stateBadge } from "./row";
import { moment, runtimeOf } from "./times";

/** Looks of the two jobs, in all parts of the comparison. */
const LOOKS = ["first", "second"] as const;

export async function compareJobs(place: HTMLElement, ids: readonly string[], context: Context): Promise<void> {
  const [a, b] = ids;
  if (!a || !b || ids.length > 2) {
    const text = "A comparison has two jobs: select them in the list, or name them in the address, as in ";
    return void put(place, h("p", { class: "card" }, text, h("code", {}, "#/jobs?compare=job-1,job-2"), ". ", h("a", { href: link("jobs") }, "All jobs")));
  }
  const pair = await Promise.all([readJob(a, context.signal), readJob(b, context.signal)]);
  const heads = h("div", { class: "compared" });
  const [curves, results, settings] = [comparedCurves(pair, context), h("div"), h("div")];
  const show = (): void => {
    put(heads, ...pair.map(head));
    put(results, ...resultTable(pair));
    put(settings, ...settingsTable(pair));
    curves.show(pair);
  };
  put(place, h("div", { class: "compare-jobs" }, h("p", {}, h("a", { href: link("jobs") }, "All jobs")), heads, curves.element, results, settings));
  show();
  await Promise.all(pair.map(async (job, i) => {
    if (hasEnded(job)) return;
    await follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => ((pair[i] = JSON.parse(event.data) as Job), show()), context.signal);
  }));
}

/** A job's name, state and result in a phrase. */
function head(job: Job, index: number): HTMLElement {
  const facts = [job.id, kindOf(job), job.started == null ? "" : runtimeOf(job), job.owner ?? ""].filter(Boolean).join(" · ");
  const result = job.state === "succeeded" ? [h("p", { class: "phrase" }, job.summary ?? subjectOf(job))] : resultOf(job);
  return h(
    "section",
    { class: `card stack compared-job ${LOOKS[index]}`, "data-job": job.id, "aria-label": job.id },
    h("div", { class: "row between" }, h("h2", {}, h("a", { href: link("jobs", [job.id]) }, titleOf(job))), stateBadge(job)),
    h("p", { class: "row soft small" }, facts, job.started == null ? null : moment(job.started)),
    h("div", { class: "progress" }, ...result),
    job.note ? h("p", { class: "quoted" }, job.note) : null,
    viewOf(job) ? h("p", {}, h("a", { href: viewOf(job) }, "Open in its view")) : null,
  );
}

/** The scalars of both results. */
function resultTable(pair: readonly Job[]): HTMLElement[] {
  const [one, other] = pair.map((job): Setting[] => resultScalars(job).map(([path, text]) => ({ path, text }))) as [Setting[], Setting[]];
  if (!one.length && !other.length) return [];
  const { differing, equal } = differences(one, other);
  const body = differing.length ? table("Results", pair, differing) : h("p", { class: "soft" }, "All figures of the results are equal.");
  return [h("section", { class: "card stack", "aria-label": "Results" }, h("h2", {}, "Results"), body, equalOnes(equal, "figure"))];
}

/** The settings that differ; equal ones are folded. */
function settingsTable(pair: readonly Job[]): HTMLElement[] {
  const settingsOf = (job: Job): Setting[] => {
    const own = flatten(job.config).filter((s) => s.path !== "seed");
    return [{ path: "kind", text: kindOf(job) }, ...own, { path: "seed", text: String(job.seed) }, { path: "program", text: `iplw ${job.version}` }];
  };
  const { differing, equal } = differences(settingsOf(pair[0]!), settingsOf(pair[1]!));
  const body = differing.length ? table("Settings", pair, differing) : h("p", { class: "soft" }, "Both jobs have the same settings.");
  return [h("section", { class: "card stack", "aria-label": "Settings" }, h("h2", {}, "Differing settings"), body, equalOnes(equal, "setting"))];
}

function table(caption: string, pair: readonly Job[], rows: readonly { path: string; texts: [string | null, string | null] }[]): HTMLElement {
  const heads = pair.map((job, i) => h("th", { scope: "col" }, h("span", { class: `run-key ${LOOKS[i]}` }), job.id));
  const cell = (text: string | null): Child => text ?? h("span", { class: "soft" }, "not set");
  const body = rows.map(({ path, texts }) => h("tr", { "data-path": path }, h("th", { scope: "row" }, path), ...texts.map((text) => h("td", {}, cell(text)))));
  return h("table", { class: "differences" }, h("caption", { class: "unseen" }, caption), h("thead", {}, h("tr", {}, h("th", { scope: "col" }, h("span", { class: "unseen" }, "Name")), ...heads)), h("tbody", {}, ...body));
}

function equalOnes(equal: readonly Setting[], noun: string): HTMLElement | null {
  if (!equal.length) return null;
  const rows = equal.map(({ path, text }) => h("tr", {}, h("th", { scope: "row" }, path), h("td", {}, text)));
  return h("details", {}, h("summary", {}, equal.length === 1 ? `1 equal ${noun}` : `${equal.length} equal ${noun}s`), h("table", { class: "details" }, h("tbody", {}, ...rows)));
}
