// One job: name, state, result with its report, note, details and log.

import { follow } from "../../api/events";
import { hasEnded } from "../../api/jobState";
import { h, put } from "../../dom";
import { shareButtons } from "../../parts/share";
import { type Context, link } from "../../view";
import { details } from "./details";
import { type Job, readJob, titleOf, viewOf } from "./job";
import { jobLog } from "./log";
import { jobNote } from "./note";
import { editableName } from "./rename";
import { resultSection } from "./result";
import { progressOf, removeButton, stateBadge } from "./row";
import { runtimeOf } from "./times";

export async function jobPage(place: HTMLElement, id: string, context: Context): Promise<void> {
  const job = await readJob(id, context.signal);
  const [top, log, note, facts] = [header(job, context), jobLog(id, context), jobNote(job, context.signal), details()];
  const outcome = h("div", { class: "outcome" });
  let state = "";
  const show = (now: Job): void => {
    top.show(now);
    note.show(now);
    facts.show(now);
    log.update();
    if (now.state === state) return;
    put(outcome, now.state === "succeeded" ? resultSection(now, context) : null);
    if (state) context.say(`${id} is ${now.state}.`);
    state = now.state;
  };
  put(place, h("div", { class: "job-page" }, top.element, h("div", { class: "job-main" }, outcome, log.element), h("div", { class: "job-side" }, note.element, facts.element)));
  show(job);
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => show(JSON.parse(event.data) as Job), context.signal);
}

interface Header {
  element: HTMLElement;
  show: (job: Job) => void;
}

function header(first: Job, context: Context): Header {
  const name = editableName(first, (job) => h("h2", {}, titleOf(job)), context);
  const [facts, progress, actions] = [h("p", { class: "row job-facts" }), h("div", { class: "progress" }), h("div", { class: "row between" })];
  const element = h("section", { class: "card stack job-head", "aria-label": "Job", "data-job": first.id }, h("p", {}, h("a", { href: link("jobs") }, "All jobs")), name.element, facts, progress, actions);
  let key = "";
  const show = (job: Job): void => {
    name.show(job);
    const words = [job.id, job.started == null ? "" : `${hasEnded(job) ? "took" : "running for"} ${runtimeOf(job)}`, job.owner ? `by ${job.owner}` : ""].filter(Boolean);
    put(facts, stateBadge(job), h("span", { class: "soft" }, words.join(" · ")));
    put(progress, ...(hasEnded(job) ? [] : progressOf(job)), job.state === "failed" ? h("p", { class: "why" }, job.error?.detail ?? "It failed without a message.") : null);
    progress.hidden = !progress.childElementCount;
    // Buttons are replaced only when others are needed, so that they keep the focus.
    if (key === job.state) return;
    key = job.state;
    put(actions, mainActions(job, context), shareButtons(job, context.signal));
  };
  return { element, show };
}

function mainActions(job: Job, context: Context): HTMLElement {
  const view = viewOf(job);
  const open = view ? h("a", { href: view, class: "button main" }, "Open in its view") : null;
  const compare = h("a", { href: link("jobs", [], { kind: job.kind, with: job.id }), class: "button" }, "Compare with another");
  const leave = (): void => void (location.hash = link("jobs"));
  return h("div", { class: "row" }, open, compare, removeButton(job, leave, context));
}
