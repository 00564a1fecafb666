// Exports a scene as a file and as commands that create a world from it.

import { curlRequest, pythonProgram } from "../../scene/code";
import type { Scene } from "../../scene/types";

/** A file name for the scene. */
export function filename(scene: Scene): string {
  const safe = (scene.name ?? "").replaceAll(/[^\p{L}\p{N}._-]+/gu, "-").replaceAll(/^[-.]+|-+$/g, "");
  return `${safe || "scene"}.json`;
}

/** A curl command that creates a world of the scene. */
export function curl(scene: Scene, server: string, token: boolean): string {
  return curlRequest(`${server}/v1/worlds`, "", scene, token);
}

/** Python code that creates a world of the scene and makes a step. */
export function python(scene: Scene, server: string): string {
  return pythonProgram(scene, server, ", client.create_world(scene=scene) as world", [
    "world.reset(seed=1)",
    "observation, reward, terminated, truncated, info = world.step([0.5] * world.dimension)",
    "print(world.id, reward, info)",
  ]);
}
