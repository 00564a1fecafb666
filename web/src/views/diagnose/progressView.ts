// A diagnosis in progress: stages, elapsed time, cancellation; then its result.

import { api, ok, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { h, put } from "../../dom";
import { duration } from "../../parts/time";
import { type Context, link } from "../../view";
import type { Report } from "./report";
import { showResult } from "./result";
import { submittedTracks } from "./preview";
import { stageList } from "./stages";

type Job = Schema<"JobOut">;

/** Time between updates of the elapsed time, ms. */
const TICK_MS = 1_000;

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
  const tracks = h("section", { class: "card stack submitted", "aria-label": "Trials" }, h("p", { class: "soft" }, "Reading the trials…"));
  put(place, h("div", { class: "stack" }, view.element, tracks));
  show(first);
  if (done) return;
  submittedTracks(id, signal).then((content) => put(tracks, h("h2", {}, "The trials as the server reads them"), ...content)).catch(context.fail);
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => show(JSON.parse(event.data) as Job), signal);
}

const TITLES: Record<string, string> = { queued: "The diagnosis is queued", failed: "The diagnosis failed", cancelled: "The diagnosis was cancelled" };

/** Progress with the stages passed so far. */
function progress(id: string, context: Context): { element: HTMLElement; show: (job: Job) => void } {
  const [title, state, elapsed] = [h("h2", {}), h("span", { class: "state" }), h("span", { class: "soft" })];
  const bar = h("progress", { "aria-label": `Progress of ${id}` });
  const queued = h("p", { class: "soft" }, "It starts when the jobs before it have ended. It continues if this page is closed.");
  const failure = h("p", { class: "why" });
  const stages = stageList(id, context);
  const cancel = cancelButton(id, context);
  const element = h(
    "section",
    { class: "card stack", "data-job": id, "aria-label": "Progress" },
    h("div", { class: "row between" }, title, h("span", { class: "row" }, elapsed, state)),
    bar,
    queued,
    stages.element,
    failure,
    h("div", { class: "row" }, cancel, h("a", { href: link("diagnose") }, "Back to the tracks"), h("a", { href: link("jobs", [id]) }, "The job")),
  );
  let [job, stage]: [Job | null, string] = [null, ""];
  const tick = (): void => {
    const start = stages.start();
    put(elapsed, start === null || job?.state !== "running" ? null : `${duration(Date.now() / 1e3 - start)} elapsed`);
  };
  const timer = setInterval(tick, TICK_MS);
  context.signal.addEventListener("abort", () => clearInterval(timer), { once: true });
  const show = (now: Job): void => {
    job = now;
    const hasEnded = ["failed", "cancelled"].includes(now.state);
    put(title, TITLES[now.state] ?? "The diagnosis is running");
    put(state, now.state);
    state.className = `state ${now.state}`;
    bar.hidden = cancel.hidden = hasEnded;
    queued.hidden = now.state !== "queued";
    put(failure, now.state === "failed" ? (now.error?.detail ?? "It failed without a message.") : null);
    const { done, total } = now.progress;
    if (total > 1) [bar.max, bar.value] = [total, done];
    else bar.removeAttribute("value");
    if (now.progress.stage !== stage && !hasEnded) context.say(now.progress.stage);
    stage = now.progress.stage;
    stages.update(now);
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
