// A diagnosis in progress: stage, progress, cancellation; then its result.

import { api, ok, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { h, put } from "../../dom";
import { type Context, link } from "../../view";
import { duration } from "../jobs";
import type { Report } from "./report";
import { showResult } from "./result";
import { submittedTracks } from "./preview";

type Job = Schema<"JobOut">;

/** Follows a job until it ends, then displays its result. */
export async function progressView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const first = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }));
  if (first.kind !== "diagnose") throw new Error(`${id} is not a diagnosis; see it under Jobs.`);
  const view = progress(id, context);
  let done = false;
  const show = (job: Job): void => {
    if (done) return;
    if (job.state === "succeeded") {
      done = true;
      context.say("The diagnosis is finished.");
      showResult(place, job.result as unknown as Report, job, context).catch(context.fail);
    } else view.show(job);
  };
  const tracks = h("div", { class: "stack given" });
  put(place, view.element, tracks);
  show(first);
  if (done) return;
  submittedTracks(id, signal).then((stagesSeen) => put(tracks, ...stagesSeen)).catch(context.fail);
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => show(JSON.parse(event.data) as Job), signal);
}

/** Progress with the stages passed so far. */
function progress(id: string, context: Context): { element: HTMLElement; show: (job: Job) => void } {
  const state = h("span", { class: "state" });
  const [bar, words, stages] = [h("progress", { "aria-label": `Progress of ${id}` }), h("span", { class: "soft" }), h("ol", { class: "stages" })];
  const cancel = h("button", { type: "button" }, "Cancel");
  const failure = h("p", { class: "why" });
  const stagesSeen: string[] = [];
  cancel.addEventListener("click", () => {
    cancel.disabled = true;
    put(cancel, "Cancelling…");
    ok(api.DELETE("/v1/jobs/{id}", { params: { path: { id } } }) as Promise<{ data?: unknown; response: Response }>).catch((e: unknown) => {
      cancel.disabled = false;
      put(cancel, "Cancel");
      context.fail(e);
    });
  });
  const element = h(
    "section",
    { class: "card stack", "data-job": id, "aria-label": "The diagnosis" },
    h("div", { class: "row between" }, h("h2", {}, "The diagnosis is running"), state),
    bar,
    words,
    stages,
    failure,
    h("div", { class: "row" }, cancel, h("a", { href: link("diagnose") }, "Back to the tracks"), h("a", { href: link("jobs", [id]) }, "The job")),
  );
  const show = (job: Job): void => {
    const ended = ["failed", "cancelled"].includes(job.state);
    put(state, job.state);
    state.className = `state ${job.state}`;
    bar.hidden = cancel.hidden = ended;
    put(failure, job.state === "failed" ? (job.error?.detail ?? "It failed without a message.") : null);
    const { stage, done, total, eta_s: left } = job.progress;
    if (total > 0) [bar.max, bar.value] = [total, done];
    else bar.removeAttribute("value");
    put(words, ended ? null : `${total > 0 ? `${done} of ${total}` : ""}${typeof left === "number" ? `, ${duration(left)} left of this stage` : ""}`);
    if (stage && stagesSeen.at(-1) !== stage) {
      stagesSeen.push(stage);
      put(stages, ...stagesSeen.map((text) => h("li", { "aria-current": text === stage && !ended ? "step" : null }, text)));
      if (!ended) context.say(stage);
    }
    put(element.querySelector("h2")!, { failed: "The diagnosis failed", cancelled: "The diagnosis was cancelled" }[job.state] ?? (job.state === "queued" ? "The diagnosis is queued" : "The diagnosis is running"));
  };
  return { element, show };
}
