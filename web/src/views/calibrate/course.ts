// An estimation as it goes: its job by events, its rounds asked for when something of them changed.

import { api, ok, type Schema } from "../../api/client";
import { reconnected, isLost } from "../../api/connection";
import { follow } from "../../api/events";
import { latest } from "../../parts/latest";

export type Job = Schema<"JobOut">;
export type Round = Schema<"RoundOut">;
export type Known = Schema<"KnownOut">;
/** What was asked for; the fields of a request that were given. */
export type Asked = Partial<Schema<"Estimation">>;

/** Rounds asked for at a time. */
const PAGE = 50;

/** Where an estimation stands. */
export interface Standing {
  job: Job;
  rounds: readonly Round[];
  /** Real interactions so far, those of the open round too. */
  interactions: number;
}

/** Follows an estimation to its end: `moved` with every event, `stands` when rounds may have changed. */
export async function followed(id: string, moved: (job: Job) => void, stands: (now: Standing) => void, signal: AbortSignal, fail: (e: unknown) => void): Promise<void> {
  const first = await estimation(id, signal);
  const ask = rounds(id, signal);
  const look = latest<Job>(async (job) => {
    for (;;) {
      try {
        stands({ job, ...(await ask()) });
        return;
      } catch (e) {
        if (signal.aborted) return;
        if (!isLost()) return fail(e);
        await reconnected();
      }
    }
  });
  let seen = "";
  const take = (job: Job): void => {
    moved(job);
    const now = `${job.state} ${job.progress.stage} ${job.state === "waiting" ? job.progress.done : ""}`;
    if (now !== seen) look(job);
    seen = now;
  };
  take(first);
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => take(JSON.parse(event.data) as Job), signal);
}

/** A job, which must be an estimation. */
export async function estimation(id: string, signal: AbortSignal): Promise<Job> {
  const job = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }));
  if (job.kind !== "iplw") throw new Error(`${id} is no estimation: jobs of the kind “${job.kind}” have no rounds.`);
  return job;
}

/** A function that asks for the rounds; those of whole pages are asked for once. */
function rounds(id: string, signal: AbortSignal): () => Promise<Omit<Standing, "job">> {
  const kept: Round[] = [];
  let cursor: string | undefined;
  return async () => {
    for (;;) {
      const query = { limit: PAGE, ...(cursor ? { cursor } : {}) };
      const page = await ok(api.GET("/v1/iplw/{id}/rounds", { params: { path: { id }, query }, signal }));
      if (!page.next) return { rounds: [...kept, ...page.rounds], interactions: page.interactions };
      kept.push(...page.rounds);
      cursor = page.next;
    }
  };
}

/** What a job was asked for. */
export function asked(job: Job): Asked {
  return job.config as Asked;
}

/** Most rounds of an estimation. */
export function planned(job: Job): number {
  return asked(job).rounds ?? 5;
}

/** Whether an estimation asks for measurements. */
export function isRig(job: Job): boolean {
  return asked(job).real === "ask_tell";
}

export function ended(job: Job): boolean {
  return ["succeeded", "failed", "cancelled"].includes(job.state);
}

/** What is known in the end, or after the last round that was fitted. */
export function known(standing: Standing): readonly Known[] {
  const result = standing.job.result as { latents?: Known[]; effects?: Known[] } | null | undefined;
  if (result?.latents) return [...result.latents, ...(result.effects ?? [])];
  return standing.rounds.filter((r) => r.latents.length > 0).at(-1)?.latents ?? [];
}

/** An estimate as a simulation takes it: latents, and effects whose parameters were fitted along. */
export function physics(found: readonly Known[]): { latents: Record<string, number>; effects: { name: string; parameters: Record<string, number> }[] } {
  const latents: Record<string, number> = {};
  const effects = new Map<string, Record<string, number>>();
  for (const { name, value } of found) {
    const [effect, parameter] = name.split(".", 2) as [string, string | undefined];
    if (parameter === undefined) latents[name] = value;
    else effects.set(effect, { ...effects.get(effect), [parameter]: value });
  }
  return { latents, effects: [...effects].map(([name, parameters]) => ({ name, parameters })) };
}
