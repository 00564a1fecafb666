// The scene of an estimation with its estimates: played, planned in and exported.

import { applyAction, valueAt } from "../../scene/action";
import type { Body, Scene } from "../../scene/types";
import { currentEstimates, type EstimationState, simulationPhysics } from "./estimation";
import { sceneOfTask } from "./rounds";

export interface CalibratedWorld {
  /** Task of the scene: `bowling:017`. */
  task: string;
  scene: Scene;
  /** The scene in the initial state of the last measured proposal. */
  launched: Scene;
}

/** The scene of the last measured proposal with the estimates; `null` if nothing was measured. */
export async function calibratedScene(now: EstimationState, signal: AbortSignal): Promise<CalibratedWorld | null> {
  const proposal = now.rounds.flatMap((r) => r.proposals).filter((p) => p.measured).at(-1);
  if (!proposal) return null;
  const scene = withPhysics(await sceneOfTask(proposal.task, signal), simulationPhysics(currentEstimates(now)));
  return { task: proposal.task, scene, launched: launch(scene, proposal.action) };
}

/** The scene in the initial state that an action sets, without an action space. */
export function launch(scene: Scene, action: readonly number[]): Scene {
  const { action: space, ...placed } = applyAction(scene, action);
  const bodies = placed.bodies.map((body) => {
    const moving = { ...body };
    (space?.components ?? []).forEach((component, i) => {
      if (component.target !== body.name) return;
      const value = valueAt(component, action[i] ?? 0);
      const [vx, vy] = moving.velocity ?? [0, 0];
      if (component.set === "vx") moving.velocity = [value, vy];
      else if (component.set === "vy") moving.velocity = [vx, value];
      else if (component.set === "omega") moving.angular_velocity = value;
    });
    return moving;
  });
  return { ...placed, bodies };
}

/** A scene with latents at the objects that carry them (all bodies, unless the scene names them), and with effects. */
export function withPhysics(scene: Scene, { latents, effects }: ReturnType<typeof simulationPhysics>): Scene {
  const carriers = scene.carriers ?? scene.bodies.map((b) => b.name);
  const { density: _density, ...withoutDensity } = latents;
  // A given mass stays.
  const set = (body: Body): Body => (carriers.includes(body.name) ? { ...body, ...(body.mass === undefined ? latents : withoutDensity) } : body);
  const names = effects.map((e) => e.name);
  const others = ((scene.effects as typeof effects | undefined) ?? []).filter((e) => !names.includes(e.name));
  return {
    ...scene,
    name: `${scene.name || "scene"}, calibrated`,
    bodies: scene.bodies.map(set),
    ...(scene.statics ? { statics: scene.statics.map(set) } : {}),
    ...(others.length + effects.length ? { effects: [...others, ...effects] } : {}),
  };
}
