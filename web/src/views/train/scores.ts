// AUCCESS and related statistics of evaluations (PHYRE, Bakhtin et al. 2019, section 3).

import type { Schema } from "../../api/client";

/** Attempts for each task that count. */
export const ATTEMPTS = 100;
/** The built-in policy with a random order of actions. */
export const CHANCE = "random";
/** 97.5 % quantile of the normal distribution. */
const Z_95 = 1.96;

/** A finished evaluation with its request. */
export interface Evaluation {
  job: string;
  policy: string;
  world: string;
  split: string;
  attempts: number;
  seed: number;
  auccess: number;
  /** The attempt that first solved each task. */
  solvedAt: (number | null)[];
  interactions: number;
}

/** Evaluations with equal settings are comparable. */
export interface EvaluationSetting {
  world: string;
  split: string;
  attempts: number;
  seed: number;
}

/** The evaluation of a job; `null` if it is not a successful evaluation. */
export function evaluation(job: Schema<"JobOut">): Evaluation | null {
  const result = job.result as EvaluationResult | null | undefined;
  if (job.kind !== "evaluate" || !result) return null;
  const of = requestOf(job);
  return {
    job: job.id,
    policy: of.policy,
    world: of.world,
    split: of.split ?? "test",
    attempts: of.attempts ?? ATTEMPTS,
    seed: job.seed,
    auccess: result.auccess,
    solvedAt: result.tasks.map((t) => t.solved_at),
    interactions: result.interactions,
  };
}

/** Whether an evaluation has a setting. */
export function hasSetting(one: EvaluationSetting, setting: EvaluationSetting): boolean {
  return one.world === setting.world && one.split === setting.split && one.attempts === setting.attempts && one.seed === setting.seed;
}

/** Contribution of one task, 0 to 1: the normalised sum of the weights ln(k + 1) - ln(k) of attempts `solvedAt` and later. */
export function taskScore(solvedAt: number | null): number {
  return solvedAt === null || solvedAt > ATTEMPTS ? 0 : Math.log((ATTEMPTS + 1) / solvedAt) / Math.log(ATTEMPTS + 1);
}

export interface Interval {
  value: number;
  low: number;
  high: number;
}

/** AUCCESS with its 95 % interval over tasks. */
export function auccess(solvedAt: readonly (number | null)[]): Interval {
  return mean(solvedAt.map(taskScore));
}

/** Share of tasks solved within 1, 2, ... `attempts`, with Wilson's 95 % interval. */
export function curve(solvedAt: readonly (number | null)[], attempts: number): Interval[] {
  return Array.from({ length: attempts }, (_, i) => {
    const solved = solvedAt.filter((k) => k !== null && k <= i + 1).length;
    return wilson(solved, solvedAt.length);
  });
}

/** A proportion with Wilson's interval (1927), which stays within 0 and 1 and is not empty at the ends. */
export function wilson(hits: number, of: number): Interval {
  if (of === 0) return { value: 0, low: 0, high: 1 };
  const p = hits / of;
  const [middle, spread] = [p + (Z_95 * Z_95) / (2 * of), Z_95 * Math.sqrt((p * (1 - p)) / of + (Z_95 * Z_95) / (4 * of * of))];
  const under = 1 + (Z_95 * Z_95) / of;
  return { value: p, low: Math.max(0, (middle - spread) / under), high: Math.min(1, (middle + spread) / under) };
}

/** A mean with its 95 % interval, within 0 and 1. */
export function mean(values: readonly number[]): Interval {
  const n = values.length;
  if (n === 0) return { value: 0, low: 0, high: 1 };
  const value = values.reduce((a, b) => a + b, 0) / n;
  if (n === 1) return { value, low: 0, high: 1 };
  const variance = values.reduce((sum, v) => sum + (v - value) ** 2, 0) / (n - 1);
  const spread = Z_95 * Math.sqrt(variance / n);
  return { value, low: Math.max(0, value - spread), high: Math.min(1, value + spread) };
}

/** Difference of two policies on the same tasks with its 95 % interval, from paired differences, which is narrower than the
 * difference of two means. `null` if the tasks differ. */
export function difference(one: readonly (number | null)[], other: readonly (number | null)[]): Interval | null {
  if (one.length !== other.length || !one.length) return null;
  const differences = one.map((k, i) => taskScore(k) - taskScore(other[i]!));
  const n = differences.length;
  const value = differences.reduce((a, b) => a + b, 0) / n;
  const variance = differences.reduce((sum, v) => sum + (v - value) ** 2, 0) / Math.max(1, n - 1);
  const spread = Z_95 * Math.sqrt(variance / n);
  return { value, low: Math.max(-1, value - spread), high: Math.min(1, value + spread) };
}

/** Means of at most `most` blocks of values, each at the index of its end, as the server reports them. */
export function means(values: readonly number[], most: number): { at: number; value: number }[] {
  const every = Math.max(1, Math.ceil(values.length / most));
  return Array.from({ length: Math.ceil(values.length / every) }, (_, i) => {
    const part = values.slice(i * every, (i + 1) * every);
    return { at: i * every + part.length, value: part.reduce((a, b) => a + b, 0) / part.length };
  });
}

/** `0.61 (0.52 to 0.70)` */
export function interval({ value, low, high }: Interval, signed = false): string {
  const format = (v: number): string => `${signed && v > 0 ? "+" : ""}${v.toFixed(2)}`;
  return `${format(value)} (${format(low)} to ${format(high)})`;
}

/** The request of an evaluation. */
export function requestOf(job: Schema<"JobOut">): EvaluationRequest {
  return job.config as unknown as EvaluationRequest;
}

export interface EvaluationRequest {
  policy: string;
  world: string;
  split?: string;
  attempts?: number;
}

interface EvaluationResult {
  auccess: number;
  interactions: number;
  tasks: { task: string; solved_at: number | null }[];
}

/** A key shared by policies that differ only by their seed, including the policies they were trained from. */
export function trainingKey(policies: readonly Schema<"PolicyOut">[], id: string): string {
  const one = policies.find((p) => p.id === id);
  // Uploaded weights are only equal to themselves.
  if (!one || one.job === null) return id;
  // Validations do not affect the training.
  const { seed: _, validations: __, policy, ...rest } = one.config as unknown as { seed?: number; validations?: number; policy?: string };
  const from = policy ? trainingKey(policies.filter((p) => p.id !== id), policy) : null;
  return JSON.stringify([one.training, from, Object.entries(rest).sort(([a], [b]) => (a < b ? -1 : 1))]);
}

/** The mean of curves of several seeds, with its 95 % interval. */
export function meanCurve(curves: readonly (readonly Interval[])[]): Interval[] {
  return (curves[0] ?? []).map((_, i) => mean(curves.map((one) => one[i]!.value)));
}

/** Centred moving average over `width` values; fewer at the ends. */
export function movingAverage(values: readonly number[], width: number): number[] {
  const half = Math.floor(width / 2);
  return values.map((_, i) => {
    const part = values.slice(Math.max(0, i - half), i + half + 1);
    return part.reduce((a, b) => a + b, 0) / part.length;
  });
}

/** A policy with its origin. */
export interface Learner {
  id: string;
  /** The policy that it was trained from in a world; `null` if none. */
  from: string | null;
  /** Attempts in a world used in that step. */
  attempts: number;
}

/** Chains of policies trained from one another, oldest first, each with the cumulative attempts in a world. */
export function learningChains(learners: readonly Learner[]): { id: string; attempts: number }[][] {
  const byId = new Map(learners.map((one) => [one.id, one]));
  const before = new Set(learners.flatMap((one) => (one.from === null ? [] : [one.from])));
  const chain = (id: string, visited: ReadonlySet<string>): { id: string; attempts: number }[] => {
    const one = byId.get(id);
    if (!one || visited.has(id)) return [];
    const earlier = one.from === null ? [] : chain(one.from, new Set([...visited, id]));
    return [...earlier, { id, attempts: (earlier.at(-1)?.attempts ?? 0) + one.attempts }];
  };
  const last = learners.filter((one) => one.from !== null && !before.has(one.id));
  return last.map((one) => chain(one.id, new Set()));
}
