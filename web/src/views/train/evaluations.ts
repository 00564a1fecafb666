// Evaluations: finished, in progress, and requests for more.

import { api, ok, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { hasEnded } from "../../api/jobState";
import { short } from "../../parts/slider";
import type { Context } from "../../view";
import { requestOf, evaluation, type Evaluation, hasSetting, type EvaluationSetting } from "./scores";

type Job = Schema<"JobOut">;

export interface Evaluations {
  /** The evaluation of a policy in a setting. */
  evaluationOf: (policy: string, setting: EvaluationSetting) => Evaluation | undefined;
  /** The unfinished evaluation of a policy. */
  running: (policy: string) => Job | undefined;
  /** Starts missing evaluations of the policies. */
  ask: (policies: readonly string[], setting: EvaluationSetting) => Promise<void>;
  /** Follows unfinished evaluations. */
  start: () => void;
}

/** `changed` is called at every event, with whether the evaluation has ended. */
export function evaluations(jobs: readonly Job[], changed: (over: boolean) => void, context: Context): Evaluations {
  const done = jobs.map(evaluation).filter((e) => e !== null);
  const unfinished = new Map(jobs.filter((job) => !hasEnded(job)).map((job) => [job.id, job]));
  // The newest one: a policy's weights may have been replaced.
  const evaluationOf = (policy: string, setting: EvaluationSetting): Evaluation | undefined => done.filter((e) => e.policy === policy && hasSetting(e, setting)).at(-1);
  const running = (policy: string): Job | undefined => [...unfinished.values()].find((job) => requestOf(job).policy === policy);
  const onJob = (job: Job): void => {
    unfinished.set(job.id, job);
    if (hasEnded(job)) {
      unfinished.delete(job.id);
      const e = evaluation(job);
      if (e) done.push(e);
      if (job.state === "failed") context.fail(new Error(`${job.id} failed: ${job.error?.detail ?? "without a message"}`));
      context.say(e ? `${e.policy}: AUCCESS ${short(e.auccess)}` : `${job.id} ${job.state}`);
    }
    changed(hasEnded(job));
  };
  const watch = (job: Job): void => {
    unfinished.set(job.id, job);
    follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => onJob(JSON.parse(event.data) as Job), context.signal).catch(context.fail);
  };
  const ask = async (policies: readonly string[], setting: EvaluationSetting): Promise<void> => {
    for (const id of policies) {
      if (evaluationOf(id, setting) || running(id)) continue;
      const body = { ...setting, split: setting.split as Schema<"SplitIn"> };
      watch(await ok(api.POST("/v1/policies/{id}/evaluate", { params: { path: { id } }, body, signal: context.signal })));
    }
  };
  return { evaluationOf: evaluationOf, running, ask, start: () => [...unfinished.values()].forEach(watch) };
}
