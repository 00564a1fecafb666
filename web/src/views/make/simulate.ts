// The draft run: what becomes of it, as it is drawn or by an action that has a place.

import { api, ok, type Schema } from "../../api/client";
import type { Film } from "../../scene/film";
import type { Scene } from "../../scene/types";

/** What a run came to. */
export interface SimulationResult {
  film: Film | null;
  solved: boolean | null;
  end: string | null;
  /** Why the action has no place. */
  reason: string | null;
}

/** Time between two samples of a film, s; and most samples of one, all bodies together: more follow a hand too slowly. */
const [SAMPLE_INTERVAL_S, MAX_SAMPLES] = [1 / 60, 12_000];
/** Most time steps between two samples that the server takes. */
const MAX_STEPS_PER_SAMPLE = 1_000_000;
/** Actions that are tried for a place. */
const CANDIDATE_ACTIONS = 512;

/** Runs a scene, with an action or as it is drawn. */
export async function simulate(scene: Scene, action: readonly number[] | null, signal: AbortSignal): Promise<SimulationResult> {
  const body = { scene: scene as unknown as Record<string, never>, observe_every: observeEvery(scene), ...(action ? { action: [...action] } : {}) };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  const film = answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: answer.contacts } : null;
  return { film, solved: answer.solved ?? null, end: answer.end ?? null, reason: answer.reason ?? null };
}

/** An action that has a place, the first of an even spread from a start on; `null` where none was found. */
export async function findValidAction(scene: Scene, start: number, signal: AbortSignal): Promise<number[] | null> {
  const dimension = scene.action?.components.length ?? 0;
  if (!dimension) return null;
  const actions = Array.from({ length: CANDIDATE_ACTIONS }, (_, i) => quasiRandomPoint(dimension, start + i));
  const { reasons }: Schema<"Places"> = await ok(api.POST("/v1/place", { body: { scene: scene as unknown as Record<string, never>, actions }, signal }));
  return actions[reasons.findIndex((r) => r === null)] ?? null;
}

/** Whether a body needs an action to be anywhere. */
export function needsAction(scene: Scene): boolean {
  return Boolean(scene.action) && scene.bodies.some((b) => !b.position);
}

/** Point `index` of the additive recurrence R_d (Roberts 2018) in the unit cube; the first is its middle. */
export function quasiRandomPoint(dimension: number, index: number): number[] {
  let phi = 2;
  for (let i = 0; i < 40; i++) phi = (1 + phi) ** (1 / (dimension + 1));
  return Array.from({ length: dimension }, (_, k) => (0.5 + index / phi ** (k + 1)) % 1);
}

function observeEvery(scene: Scene): number {
  const step = typeof scene.time_step === "number" && scene.time_step > 0 ? scene.time_step : 1 / 240;
  const steps = Math.max(1, Math.round(SAMPLE_INTERVAL_S / step), Math.ceil(((scene.steps ?? 4000) * scene.bodies.length) / MAX_SAMPLES));
  // Whatever the scene's own numbers are: if they are wrong the server is to say so of them.
  return Math.min(steps, MAX_STEPS_PER_SAMPLE);
}
