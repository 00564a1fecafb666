// A diagnosis in progress, with the submitted tracks; then its result.

import { api, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import { followJob } from "../../parts/jobProgress";
import { type Context, link } from "../../view";
import { submittedTracks } from "./preview";
import type { Report } from "./report";
import { showResult } from "./result";
import { stageList } from "./stages";

type Job = Schema<"JobOut">;

/** Follows a diagnosis until it ends, then displays its result. */
export async function progressView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const job = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }));
  if (job.kind !== "diagnose") throw new Error(`${id} is not a diagnosis; see it under Jobs.`);
  // Diagnoses of mechanisms have a view of their own.
  if ("joints" in job.config) return location.replace(link("joints", [id]));
  const progress = h("div", { class: "stack" });
  const tracks = h("section", { class: "card stack submitted", "aria-label": "Trials" }, h("p", { class: "soft" }, "Reading the trials…"));
  if (job.state !== "succeeded") {
    put(place, h("div", { class: "stack" }, progress, tracks));
    submittedTracks(id, signal).then((content) => put(tracks, h("h2", {}, "The trials as the server reads them"), ...content)).catch(context.fail);
  }
  const parts = {
    subject: "The diagnosis",
    links: [h("a", { href: link("diagnose") }, "Back to the tracks"), h("a", { href: link("jobs", [id]) }, "The job")],
    queued: "It starts when the jobs before it have ended. It continues if this page is closed.",
    stages: stageList(id, context),
  };
  const onSuccess = (now: Job): void => void showResult(place, now.result as unknown as Report, now, context).catch(context.fail);
  await followJob(progress, job, parts, onSuccess, context);
}
