// The four kinds of analyses, and their jobs.

import { api, ok, type Schema } from "../../api/client";

/** A job, with the name and summary that servers of earlier versions lack. */
export type Job = Schema<"JobOut"> & { name?: string; summary?: string | null };

export interface AnalysisKind {
  /** Id of the view. */
  view: string;
  /** Kind of the job. */
  kind: string;
  /** As a title: "Plan". */
  title: string;
  /** As the subject of a sentence: "The plan". */
  subject: string;
}

/** Maximum number of jobs of a kind that are offered, newest first. */
const MAX_JOBS = 50;

/** The newest jobs of a kind, without their results. */
export async function newestJobs(kind: string, signal: AbortSignal, state?: string): Promise<Job[]> {
  const query = { kind, order: "newest", results: false, limit: MAX_JOBS, ...(state ? { state } : {}) };
  return (await ok(api.GET("/v1/jobs", { params: { query }, signal }))).jobs as Job[];
}

/** A job with its result. */
export async function jobById(id: string, signal: AbortSignal): Promise<Job> {
  return (await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }))) as Job;
}

/** The subject of a job: its name, or its task or scene. */
export function jobTitle(job: Job, kind: AnalysisKind): string {
  if (job.name) return job.name;
  const config = job.config as { task?: string; scene?: string; job?: string | null; trials?: number };
  const scene = config.task ?? config.scene;
  return [scene ? `${kind.title} of ${scene}` : kind.title, config.trials === undefined ? "" : `${config.trials} trials`].filter(Boolean).join(", ");
}
