// A job in progress: state, stages, progress bar, cancellation, and the reason of a failure.

import { api, ok, type Schema } from "../api/client";
import { follow } from "../api/events";
import { hasEnded } from "../api/jobState";
import { type Child, h, put } from "../dom";
import type { Context } from "../view";
import { codeText } from "./codeText";
import { type StageList, stageNames } from "./stageNames";
import { duration } from "./time";
import "./jobProgress.css";

type Job = Schema<"JobOut">;

export interface ProgressParts {
  /** The job as the subject of a sentence: "The plan". */
  subject: string;
  /** Links below the progress. */
  links: readonly Child[];
  /** A sentence for a queued job. */
  queued?: string;
  /** The stages; without this, their names. */
  stages?: StageList;
}

/** Time between updates of the elapsed time, ms. */
const TICK_MS = 1_000;

/** Follows a job: its progress until it ends, then `onSuccess`, once. A failed or cancelled job stays displayed. */
export async function followJob(place: HTMLElement, job: Job, parts: ProgressParts, onSuccess: (job: Job) => void, context: Context): Promise<void> {
  if (job.state === "succeeded") return onSuccess(job);
  const progress = jobProgress(job.id, parts, context);
  let ended = false;
  const show = (now: Job): void => {
    if (ended) return;
    ended = hasEnded(now);
    if (now.state === "succeeded") {
      context.say(`${parts.subject} is finished.`);
      onSuccess(now);
    } else progress.show(now);
  };
  put(place, progress.element);
  show(job);
  if (!ended) await follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => show(JSON.parse(event.data) as Job), context.signal);
}

/** The progress of a job; `show` displays a state. */
function jobProgress(id: string, { subject, links, queued, stages = stageNames() }: ProgressParts, context: Context): { element: HTMLElement; show: (job: Job) => void } {
  const [heading, state] = [h("h2"), h("span", { class: "state" })];
  const bar = h("progress", { "aria-label": `Progress of ${id}` });
  const note = queued ? h("p", { class: "soft" }, queued) : null;
  const failure = h("div", { class: "failure", role: "alert" });
  const elapsed = stages.start ? elapsedTime(stages.start, context.signal) : null;
  const cancel = cancelButton(id, context);
  let lastStage = "";
  const show = (job: Job): void => {
    const ended = hasEnded(job);
    const { stage, done, total } = job.progress;
    put(heading, `${subject} ${STATE_TEXTS[job.state] ?? "is running"}`);
    put(state, job.state);
    state.className = `state ${job.state}`;
    bar.hidden = cancel.hidden = ended;
    if (note) note.hidden = job.state !== "queued";
    // The progress within a single step is unknown.
    if (total > 1) [bar.max, bar.value] = [total, done];
    else bar.removeAttribute("value");
    put(failure, ...failureText(job));
    if (stage && stage !== lastStage && !ended) context.say(stage);
    lastStage = stage || lastStage;
    stages.update(job);
    elapsed?.show(job);
  };
  const head = h("div", { class: "row between" }, heading, h("span", { class: "row" }, elapsed?.element, state));
  const element = h("section", { class: "card stack job-progress", "data-job": id, "aria-label": subject }, head, bar, note, stages.element, failure, h("div", { class: "row" }, cancel, ...links));
  return { element, show };
}

/** The time since the start of a running job, updated until the view is closed. */
function elapsedTime(start: () => number | null, signal: AbortSignal): { element: HTMLElement; show: (job: Job) => void } {
  const element = h("span", { class: "soft" });
  let isRunning = false;
  const tick = (): void => {
    const at = start();
    put(element, at === null || !isRunning ? null : `${duration(Date.now() / 1e3 - at)} elapsed`);
  };
  const timer = setInterval(tick, TICK_MS);
  signal.addEventListener("abort", () => clearInterval(timer), { once: true });
  const show = (job: Job): void => {
    isRunning = job.state === "running";
    tick();
  };
  return { element, show };
}

function cancelButton(id: string, context: Context): HTMLButtonElement {
  const cancel = h("button", { type: "button" }, "Cancel");
  cancel.addEventListener("click", () => {
    cancel.disabled = true;
    put(cancel, "Cancelling…");
    ok(api.DELETE("/v1/jobs/{id}", { params: { path: { id } } }) as Promise<{ data?: unknown; response: Response }>).catch((e: unknown) => {
      cancel.disabled = false;
      put(cancel, "Cancel");
      context.fail(e);
    });
  });
  return cancel;
}

const STATE_TEXTS: Record<string, string> = { queued: "is queued", waiting: "waits for trials", failed: "failed", cancelled: "was cancelled" };

/** The reason of a failure, and what is allowed instead. */
function failureText(job: Job): HTMLElement[] {
  if (job.state !== "failed") return [];
  const detail = job.error?.detail ?? "It failed without a message.";
  const text = detail.charAt(0).toUpperCase() + detail.slice(1);
  return [h("p", { class: "why" }, ...codeText(/[.!?]$/.test(text) ? text : `${text}.`))];
}
