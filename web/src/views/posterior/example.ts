// The example: a few trials in a hidden bowling world with drag, measured by a short estimation, then their posterior.

import { api, ok } from "../../api/client";
import { follow } from "../../api/events";
import { hasEnded } from "../../api/jobState";
import type { Job } from "../analysis/kind";

const TRIALS = 6;

/** Measures trials, then starts a posterior of them. */
export async function startExample(say: (text: string) => void, signal: AbortSignal): Promise<Job> {
  say(`Measuring ${TRIALS} trials in a hidden bowling world…`);
  const body = { task: "bowling", rounds: 1, actions: TRIALS, samples: 12, seed: 1, real: { noise: 0.01 } };
  const estimation = await ok(api.POST("/v1/iplw", { body, signal }));
  await ended(estimation.id, signal);
  say("Sampling the posterior…");
  return ok(api.POST("/v1/posteriors", { body: { job: estimation.id, sets: [["linear_drag"]], draws: 512, seed: 1 }, signal }));
}

/** Waits until a job has ended; throws its error. */
async function ended(id: string, signal: AbortSignal): Promise<void> {
  let last: Job | null = null;
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => (last = JSON.parse(event.data) as Job), signal);
  const job = last as Job | null;
  if (job && hasEnded(job) && job.state !== "succeeded") throw new Error(`${id} ${job.state}: ${job.error?.detail ?? "no reason stated"}`);
}
