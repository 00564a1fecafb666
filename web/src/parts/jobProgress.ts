// A job in progress: state, stage, progress bar, cancellation, and the reason of a failure.

import { api, ok, type Schema } from "../api/client";
import { follow } from "../api/events";
import { type Child, h, put } from "../dom";
import { type Context, link } from "../view";
import { codeText } from "./codeText";
import { duration } from "./time";

type Job = Schema<"JobOut">;

export interface ProgressText {
  /** The job as the subject of a sentence: "The plan". */
  subject: string;
  /** Links below the progress. */
  links?: readonly Child[];
}

export interface JobProgress {
  element: HTMLElement;
  show: (job: Job) => void;
}

/** Follows a job: its progress until it ends, then `onSuccess`, once. A failed or cancelled job stays displayed. */
export async function followJob(place: HTMLElement, job: Job, text: ProgressText, onSuccess: (job: Job) => void, context: Context): Promise<void> {
  if (job.state === "succeeded") return onSuccess(job);
  const progress = jobProgress(job, text, context);
  let ended = false;
  const show = (now: Job): void => {
    if (ended) return;
    ended = hasEnded(now);
    if (now.state === "succeeded") {
      context.say(`${text.subject} is finished.`);
      onSuccess(now);
    } else progress.show(now);
  };
  put(place, progress.element);
  show(job);
  if (!ended) await follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => show(JSON.parse(event.data) as Job), context.signal);
}

/** The progress of a job; `show` displays another state. */
export function jobProgress(job: Job, { subject, links = [] }: ProgressText, context: Context): JobProgress {
  const [heading, state] = [h("h2"), h("span", { class: "state" })];
  const [bar, words, stages] = [h("progress", { "aria-label": `Progress of ${job.id}` }), h("p", { class: "soft" }), h("ol", { class: "stages" })];
  const failure = h("div", { class: "failure", role: "alert" });
  const cancel = cancelButton(job.id, context);
  const names: string[] = [];
  const show = (now: Job): void => {
    const ended = hasEnded(now);
    put(heading, `${subject} ${STATE_TEXTS[now.state] ?? "is running"}`);
    put(state, now.state);
    state.className = `state ${now.state}`;
    bar.hidden = words.hidden = cancel.hidden = ended;
    put(failure, ...failureText(now));
    const { stage, done, total, eta_s: remaining } = now.progress;
    if (total > 0) [bar.max, bar.value] = [total, done];
    else bar.removeAttribute("value");
    put(words, [total > 0 ? `${done} of ${total}` : "", typeof remaining === "number" ? `about ${duration(remaining)} more for this stage` : ""].filter(Boolean).join(", "));
    if (stage && names.at(-1) !== stage) {
      names.push(stage);
      if (!ended) context.say(stage);
    }
    put(stages, ...names.map((name, i) => h("li", { "aria-current": i === names.length - 1 && !ended ? "step" : null }, name)));
  };
  const row = h("div", { class: "row" }, cancel, ...links, h("a", { href: link("jobs", [job.id]) }, "Details of the job"));
  const head = h("div", { class: "row between" }, heading, state);
  const element = h("section", { class: "card stack job-progress", "data-job": job.id, "aria-label": subject }, head, bar, words, stages, failure, row);
  show(job);
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

/** Whether a job has ended, for any reason. */
export function hasEnded(job: Job): boolean {
  return ["succeeded", "failed", "cancelled"].includes(job.state);
}
