// Follows an estimation: its job by events; its rounds are read again when the job's stage changes.

import { api, ok, type Schema } from "../../api/client";
import { reconnected, isLost } from "../../api/connection";
import { follow } from "../../api/events";
import { latest } from "../../parts/latest";
import type { Scene } from "../../scene/types";

export type Job = Schema<"JobOut">;
export type Round = Schema<"RoundOut">;
export type LatentEstimate = Schema<"LatentEstimateOut">;
/** Fields of the request that were given. */
export type EstimationRequest = Partial<Schema<"EstimationIn">>;

/** Rounds in one page. */
const PAGE = 50;

/** State of an estimation. */
export interface EstimationState {
  job: Job;
  rounds: readonly Round[];
  /** Real interactions so far, including the open round. */
  interactions: number;
}

/** Follows an estimation to its end. `onJob` is called with every event, `onRounds` when rounds may have changed. */
export async function followEstimation(id: string, onJob: (job: Job) => void, onRounds: (now: EstimationState) => void, signal: AbortSignal, fail: (e: unknown) => void): Promise<void> {
  const first = await estimation(id, signal);
  const readRounds = roundsReader(id, signal);
  const updateRounds = latest<Job>(async (job) => {
    for (;;) {
      try {
        onRounds({ job, ...(await readRounds()) });
        return;
      } catch (e) {
        if (signal.aborted) return;
        if (!isLost()) return fail(e);
        await reconnected();
      }
    }
  });
  let lastKey = "";
  const onEvent = (job: Job): void => {
    onJob(job);
    const now = `${job.state} ${job.progress.stage} ${job.state === "waiting" ? job.progress.done : ""}`;
    if (now !== lastKey) updateRounds(job);
    lastKey = now;
  };
  onEvent(first);
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => onEvent(JSON.parse(event.data) as Job), signal);
}

/** Reads a job; throws unless it is an estimation. */
export async function estimation(id: string, signal: AbortSignal): Promise<Job> {
  const job = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }));
  if (job.kind !== "iplw") throw new Error(`${id} is not an estimation: jobs of kind “${job.kind}” have no rounds.`);
  return job;
}

/** A function that reads the rounds; complete pages are read only once. */
function roundsReader(id: string, signal: AbortSignal): () => Promise<Omit<EstimationState, "job">> {
  const complete: Round[] = [];
  let cursor: string | undefined;
  return async () => {
    for (;;) {
      const query = { limit: PAGE, ...(cursor ? { cursor } : {}) };
      const page = await ok(api.GET("/v1/iplw/{id}/rounds", { params: { path: { id }, query }, signal }));
      if (!page.next) return { rounds: [...complete, ...page.rounds], interactions: page.interactions };
      complete.push(...page.rounds);
      cursor = page.next;
    }
  };
}

/** The request of a job. */
export function requestOf(job: Job): EstimationRequest {
  return job.config as EstimationRequest;
}

/** The scene that is calibrated instead of a task, if any. */
export function sceneOfRequest(request: EstimationRequest): Scene | null {
  return (request.scene as Scene | null | undefined) ?? null;
}

/** Maximum number of rounds of an estimation. */
export function maxRounds(job: Job): number {
  return requestOf(job).rounds ?? 5;
}

/** Whether it is an ask-and-tell estimation. */
export function isAskTell(job: Job): boolean {
  return requestOf(job).real === "ask_tell";
}

/** Final estimates, or those of the last fitted round. */
export function currentEstimates(standing: EstimationState): readonly LatentEstimate[] {
  const result = standing.job.result as { latents?: LatentEstimate[]; effects?: LatentEstimate[] } | null | undefined;
  if (result?.latents) return [...result.latents, ...(result.effects ?? [])];
  return standing.rounds.filter((r) => r.latents.length > 0).at(-1)?.latents ?? [];
}

/** How well the simulation reproduces the trials. */
export interface FitQuality {
  adequate: boolean | null;
  /** Error of the best simulation, and noise, m; `null` if not checked. */
  error_m: number | null;
  noise_m: number | null;
  text: string;
}

/** The quality of a finished estimation's fit, if it was checked. */
export function fitQuality(standing: EstimationState): FitQuality | null {
  return (standing.job.result as { fit?: FitQuality | null } | null | undefined)?.fit ?? null;
}

/** Converts estimates for the simulation: latents, and effects with their fitted parameters. */
export function simulationPhysics(estimates: readonly LatentEstimate[]): { latents: Record<string, number>; effects: { name: string; parameters: Record<string, number> }[] } {
  const latents: Record<string, number> = {};
  const effects = new Map<string, Record<string, number>>();
  for (const { name, value } of estimates) {
    const [effect, parameter] = name.split(".", 2) as [string, string | undefined];
    if (parameter === undefined) latents[name] = value;
    else effects.set(effect, { ...effects.get(effect), [parameter]: value });
  }
  return { latents, effects: [...effects].map(([name, parameters]) => ({ name, parameters })) };
}
