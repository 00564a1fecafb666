// Requests for simulated films.

import { api, ok, type Schema } from "../../api/client";
import type { Film } from "../../scene/film";
import type { Scene } from "../../scene/types";
import type { EffectTerm, Latents } from "./physics";
import { type SceneEffect, sceneWithout } from "./sceneEffects";
import type { Task } from "./taskPicker";

/** Time between two samples of a film, s; below the frame time of a screen. */
const SAMPLE_INTERVAL_S = 1 / 60;
/** Time steps between samples where only the end is of interest. */
const END_ONLY_STEPS = 1_000_000;

/** Physics of a simulation. */
export interface Physics {
  latents: Latents;
  /** Effects in addition to the scene's. */
  added: readonly EffectTerm[];
  /** Effects of the scene that are off. */
  off: readonly SceneEffect[];
}

/** A simulated film and its outcome. */
export interface Simulation {
  /** `null` if the action is invalid. */
  film: Film | null;
  solved: boolean | null;
  /** Why the action is invalid. */
  reason: string | null;
}

/** Simulates an action to the end of the task's horizon. */
export async function simulate(task: Task, action: readonly number[] | null, physics: Physics, signal: AbortSignal): Promise<Simulation> {
  const step = task.scene.time_step ?? 1 / 240;
  const every = Math.max(1, Math.round(SAMPLE_INTERVAL_S / step));
  const answer = await ok(api.POST("/v1/simulate", { body: { ...request(task, action, physics), observe_every: every, stop: false }, signal }));
  return { film: answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: answer.contacts } : null, solved: answer.solved ?? null, reason: answer.reason ?? null };
}

/** The time at which the goal is reached, s; `null` if it is not. */
export async function goalTime(task: Task, action: readonly number[] | null, physics: Physics, signal: AbortSignal): Promise<number | null> {
  const { steps = 4000 } = task.scene;
  const body = { ...request(task, action, physics), observe_every: Math.min(END_ONLY_STEPS, Math.max(1, steps)), stop: true };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  return answer.end === "goal" ? (answer.t.at(-1) ?? null) : null;
}

/** Prior means of the latents, from the family's simulated world. */
export async function prior(family: string, signal: AbortSignal): Promise<Latents> {
  const { data } = await api.GET("/v1/worlds/{id}", { params: { path: { id: `${family}-sim` } }, signal });
  const latents = data?.latents;
  return { density: latents?.density ?? 1, friction: latents?.friction ?? 0.5, restitution: latents?.restitution ?? 0.5 };
}

function request(task: Task, action: readonly number[] | null, { latents, added, off }: Physics): Schema<"SimulateIn"> {
  const scene: Scene = sceneWithout(task.scene, off);
  const subject = task.family && scene === task.scene ? { task: task.id } : { scene: scene as unknown as Record<string, never> };
  return { ...subject, ...(task.scene.action && action ? { action: [...action] } : {}), latents, effects: [...added] };
}
