// A row of the list of jobs, updated in place: unchanged cells keep their elements and the focus.

import { hasEnded } from "../../api/jobState";
import { type Child, h, put, set } from "../../dom";
import { type Context, link } from "../../view";
import { type Job, kindOf, removeJob, subjectOf, titleOf, viewOf } from "./job";
import { editableName } from "./rename";
import { progressText, runtimeOf, startOf } from "./times";

export interface JobRow {
  element: HTMLTableRowElement;
  tick: HTMLInputElement;
  show: (job: Job) => void;
}

/** Handlers of a row. */
export interface RowActions {
  ticked: () => void;
  removed: () => void;
}

export function jobRow(first: Job, actions: RowActions, context: Context): JobRow {
  const { id } = first;
  const tick = h("input", { type: "checkbox", "aria-label": `Select ${id} for a comparison` });
  tick.addEventListener("change", actions.ticked);
  const name = editableName(first, (job) => h("a", { href: link("jobs", [id]), class: "title-link" }, titleOf(job)), context);
  const about = h("span", { class: "soft small" });
  const cells = new Map(["Kind", "State", "Started", "Duration", "Who", "Result", "Actions"].map((label) => [label, h("td", { "data-label": label, class: CLASSES[label] ?? null })]));
  const element = h("tr", { "data-job": id }, h("td", { class: "tick" }, tick), h("th", { scope: "row", class: "named" }, name.element, about), ...cells.values());
  const keys = new Map<string, string>();
  const fill = (label: string, key: string, make: () => Child[]): void => {
    const cell = cells.get(label)!;
    if (keys.get(label) === key) return;
    const hadFocus = cell.contains(document.activeElement);
    keys.set(label, key);
    put(cell, ...make());
    if (hadFocus) cell.querySelector<HTMLElement>("a, button")?.focus();
  };
  const show = (job: Job): void => {
    name.show(job);
    put(about, [id, job.name ? subjectOf(job) : ""].filter(Boolean).join(" · "), job.note ? h("span", { title: job.note, class: "noted" }, " · note") : null);
    fill("Kind", job.kind, () => [viewOf(job) ? h("a", { href: viewOf(job) }, kindOf(job)) : kindOf(job)]);
    fill("State", job.state, () => [stateBadge(job)]);
    const started = startOf(job);
    fill("Started", typeof started === "string" ? started : started.outerHTML, () => [started]);
    fill("Duration", runtimeOf(job), () => [runtimeOf(job)]);
    fill("Who", job.owner ?? "", () => [job.owner ?? "–"]);
    fill("Result", JSON.stringify([job.state, hasEnded(job) ? [job.summary, job.error] : job.progress]), () => resultOf(job));
    fill("Actions", String(hasEnded(job)), () => [removeButton(job, actions.removed, context)]);
  };
  show(first);
  return { element, tick, show };
}

const CLASSES: Record<string, string> = { Result: "progress", Started: "when", Duration: "when", Actions: "actions" };

/** The state as a coloured badge with its name. */
export function stateBadge(job: Pick<Job, "state">): HTMLElement {
  return h("span", { class: `state ${job.state}` }, job.state);
}

/** Progress of a job, its result in a phrase, or the reason of its failure. */
export function resultOf(job: Job): Child[] {
  if (job.state === "failed") return [h("p", { class: "why" }, job.error?.detail ?? "It failed without a message.")];
  if (job.state === "succeeded") return [job.summary ? h("span", {}, job.summary, " ") : null, h("a", { href: viewOf(job) ?? link("jobs", [job.id]) }, "Result")];
  if (hasEnded(job)) return [h("span", { class: "soft" }, "–")];
  return progressOf(job);
}

/** Progress bar and words of an unfinished job. */
export function progressOf(job: Job): Child[] {
  const { done, total } = job.progress;
  const bar = total > 0 ? h("progress", { max: total, value: done, "aria-label": `Progress of ${job.id}` }) : null;
  return [bar, h("span", { class: "soft small" }, progressText(job))];
}

/** A button that cancels an unfinished job or deletes an ended one. */
export function removeButton(job: Job, removed: () => void, context: Context): HTMLButtonElement {
  const action = hasEnded(job) ? "Delete" : "Cancel";
  const button = h("button", { type: "button" }, action);
  set(button, { "aria-label": `${action} ${job.id}` });
  button.addEventListener("click", () => {
    button.disabled = true;
    context.fail(null);
    removeJob(job.id)
      .then(removed)
      .catch((e: unknown) => ((button.disabled = false), context.fail(e)));
  });
  return button;
}
