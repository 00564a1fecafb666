// Simulates the draft, as drawn or with a valid action.

import { api, ok, type Schema } from "../../api/client";
import type { Film } from "../../scene/film";
import type { Scene } from "../../scene/types";

/** Result of a simulation. */
export interface SimulationResult {
  film: Film | null;
  solved: boolean | null;
  end: string | null;
  /** Why the action is invalid. */
  reason: string | null;
}

/** Time between two samples of a film, s, and maximum number of samples over all bodies; more would slow down dragging. */
const [SAMPLE_INTERVAL_S, MAX_SAMPLES] = [1 / 60, 12_000];
/** Maximum number of time steps between samples that the server accepts. */
const MAX_STEPS_PER_SAMPLE = 1_000_000;
/** Number of candidates in a search for a valid action. */
const CANDIDATE_ACTIONS = 512;

/** Simulates a scene, with an action or as drawn. */
export async function simulate(scene: Scene, action: readonly number[] | null, signal: AbortSignal): Promise<SimulationResult> {
  const body = { scene: scene as unknown as Record<string, never>, observe_every: observeEvery(scene), ...(action ? { action: [...action] } : {}) };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  const film = answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: answer.contacts } : null;
  return { film, solved: answer.solved ?? null, end: answer.end ?? null, reason: answer.reason ?? null };
}

/** A valid action, the first of a quasi-random sequence from index `start`; `null` if there is none. */
export async function findValidAction(scene: Scene, start: number, signal: AbortSignal): Promise<number[] | null> {
  const dimension = scene.action?.components.length ?? 0;
  if (!dimension) return null;
  const actions = Array.from({ length: CANDIDATE_ACTIONS }, (_, i) => quasiRandomPoint(dimension, start + i));
  const { reasons }: Schema<"PlacementsOut"> = await ok(api.POST("/v1/place", { body: { scene: scene as unknown as Record<string, never>, actions }, signal }));
  return actions[reasons.findIndex((r) => r === null)] ?? null;
}

/** Whether a body has no position without an action. */
export function needsAction(scene: Scene): boolean {
  return Boolean(scene.action) && scene.bodies.some((b) => !b.position);
}

/** Point `index` of the additive recurrence R_d (Roberts 2018) in the unit cube; point 0 is the centre. */
export function quasiRandomPoint(dimension: number, index: number): number[] {
  let phi = 2;
  for (let i = 0; i < 40; i++) phi = (1 + phi) ** (1 / (dimension + 1));
  return Array.from({ length: dimension }, (_, k) => (0.5 + index / phi ** (k + 1)) % 1);
}

function observeEvery(scene: Scene): number {
  const step = typeof scene.time_step === "number" && scene.time_step > 0 ? scene.time_step : 1 / 240;
  const steps = Math.max(1, Math.round(SAMPLE_INTERVAL_S / step), Math.ceil(((scene.steps ?? 4000) * scene.bodies.length) / MAX_SAMPLES));
  // Clamp invalid values of the scene, so that the server reports them instead of this field.
  return Math.min(steps, MAX_STEPS_PER_SAMPLE);
}
