// An example of a program: episodes with actions that approach a solution of the task.

import { api, ok } from "../../api/client";
import type { World } from "./messages";

/** Task of a new example world. */
const TASK = "bowling:000";
const EPISODES = 24;
/** Time between two episodes, so that they can be watched, ms. */
const PAUSE_MS = 600;
/** Tries of an episode to place an action. */
const MAX_TRIES = 10;
/** Greatest distance from the solution in the first episode, in units of the action's range. */
const FIRST_SPREAD = 0.3;

/** Creates a simulated world; returns its id. */
export async function createExample(signal: AbortSignal): Promise<string> {
  const world = await ok(api.POST("/v1/worlds", { body: { task: TASK }, signal }));
  return world.id;
}

/** Whether an example may act in a world: it must not spend real interactions or a budget. */
export function allowsExample(world: World): boolean {
  return world.kind === "sim" && world.budget == null;
}

/** Acts in a world: each action is nearer to a solving action than the one before; without a known solution all are random. */
export async function playExample(world: World, signal: AbortSignal): Promise<void> {
  const path = { id: world.id };
  const solution = await solutionOf(world, signal);
  const centre = solution?.action ?? Array.from({ length: world.action_space.dimension }, () => 0.5);
  for (let i = 0; i < EPISODES && !signal.aborted; i++) {
    const spread = solution ? FIRST_SPREAD * (1 - i / EPISODES) ** 2 : 0.5;
    await ok(api.POST("/v1/worlds/{id}/reset", { params: { path }, body: solution ? { task: solution.task } : {}, signal }));
    // An action that cannot be placed does not end the episode.
    for (let tries = 0; tries < MAX_TRIES; tries++) {
      const action = centre.map((v) => Math.min(1, Math.max(0, v + spread * (2 * Math.random() - 1))));
      const step = await ok(api.POST("/v1/worlds/{id}/step", { params: { path }, body: { action }, signal }));
      if (step.info.valid) break;
    }
    await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
  }
}

/** A solving action of the first task of a world; `null` if none is known, as for scenes of one's own. */
async function solutionOf(world: World, signal: AbortSignal): Promise<{ task: string; action: number[] } | null> {
  const [family = "", number = "0"] = world.task.split(":");
  const { data } = await api.GET("/v1/tasks/{family}/{number}", { params: { path: { family, number } }, signal });
  return data?.certificate ? { task: data.id, action: data.certificate.action } : null;
}
