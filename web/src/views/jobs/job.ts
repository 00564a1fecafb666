// A job: its title, kind, view and times; changes of its name and note.

import { api, ok, problem, type Schema, send } from "../../api/client";
import { ProblemError } from "../../api/problem";
import { link } from "../../view";

/** A job. Servers of earlier versions do not have the optional fields. */
export type Job = Schema<"JobOut"> & {
  name?: string;
  note?: string;
  owner?: string | null;
  /** Unix times, s. */
  created?: number | null;
  started?: number | null;
  ended?: number | null;
  /** The result in a phrase. */
  summary?: string | null;
};

/** States of jobs, in the order of a job's life. */
export const STATES = ["queued", "running", "waiting", "succeeded", "failed", "cancelled"] as const;

/** Kind of job -> its name. */
export const KINDS: Readonly<Record<string, string>> = {
  iplw: "Estimation",
  diagnose: "Diagnosis",
  posterior: "Posterior",
  likelihood: "Likelihood",
  plan: "Plan",
  design: "Design",
  surface: "Surface",
  train: "Training",
  learn: "Further training",
  evaluate: "Evaluation",
};

/** Kind of job -> view that displays it. */
const VIEWS: Readonly<Record<string, string>> = {
  iplw: "calibrate",
  diagnose: "diagnose",
  posterior: "posterior",
  plan: "plan",
  design: "design",
  surface: "surface",
  train: "train",
  learn: "train",
  evaluate: "train",
};

/** Kinds that train a policy. */
export const TRAININGS: readonly string[] = ["train", "learn"];

/** Link to the view that displays the job; `null` if there is none. */
export function viewOf(job: Job): string | null {
  const view = VIEWS[job.kind];
  return view ? link(view, [job.id]) : null;
}

export function kindOf(job: Pick<Job, "kind">): string {
  return KINDS[job.kind] ?? job.kind;
}

/** The job's name, else its kind and subject. */
export function titleOf(job: Job): string {
  return job.name || [kindOf(job), subjectOf(job)].filter(Boolean).join(": ");
}

/** Task, scene, policy and world of a job, as far as its request names them. */
export function subjectOf(job: Job): string {
  const config = job.config as Record<string, unknown>;
  const text = (key: string): string | null => (typeof config[key] === "string" ? (config[key] as string) : null);
  const scene = (config.scene as { name?: unknown } | null | undefined)?.name;
  const subject = [text("task") ?? (typeof scene === "string" ? scene : null), text("policy")].filter(Boolean).join(", ");
  const world = text("world");
  return subject && world ? `${subject} in ${world}` : (world ?? subject);
}

/** Seconds that a job has run; `null` if it has not started. */
export function durationOf(job: Job, now = Date.now() / 1e3): number | null {
  if (job.started == null) return null;
  return Math.max(0, (job.ended ?? now) - job.started);
}

/** Reads a job with its result. */
export async function readJob(id: string, signal: AbortSignal): Promise<Job> {
  return ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }));
}

/** Cancels an unfinished job, or deletes an ended one. */
export async function removeJob(id: string): Promise<void> {
  await ok(api.DELETE("/v1/jobs/{id}", { params: { path: { id } } }) as Promise<{ data?: unknown; response: Response }>);
}

/** Sets the name or the note of a job. Not aborted when the view is left: what was typed is saved. */
export async function changeJob(id: string, change: { name?: string; note?: string }): Promise<void> {
  const headers = { "Content-Type": "application/json" };
  const response = await send(new Request(`/v1/jobs/${encodeURIComponent(id)}`, { method: "PATCH", headers, body: JSON.stringify(change) }));
  if (!response.ok) throw new ProblemError(problem(await response.json().catch(() => null), response));
}
