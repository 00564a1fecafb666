// Actions: what their numbers mean in a scene. Whether one has a place, the server says.

import { type Component, allObjects, type Scene } from "./types";

/** What a component of an action sets at `share` (0 to 1), SI. */
export function valueAt(component: Component, share: number): number {
  return component.low + share * (component.high - component.low);
}

/** The share at which a component sets `wanted`, within 0 to 1. */
export function shareFor(component: Component, target: number): number {
  const span = component.high - component.low;
  return span === 0 ? 0 : Math.min(1, Math.max(0, (target - component.low) / span));
}

/** The scene with an action carried out, as far as it is drawn. */
export function applyAction(scene: Scene, action: readonly number[]): Scene {
  const copy = structuredClone(scene);
  const objects = new Map(allObjects(copy).map((b) => [b.name, b]));
  (copy.action?.components ?? []).forEach((component, i) => {
    const object = objects.get(component.target);
    if (!object) return;
    const set = valueAt(component, action[i] ?? 0);
    const position = object.position ?? [0, 0];
    if (component.set === "x") object.position = [set, position[1]];
    else if (component.set === "y") object.position = [position[0], set];
    else if (component.set === "angle") object.angle = set;
    else if (component.set === "radius" && object.shape.type === "disc") object.shape.radius = set;
  });
  return copy;
}

/** Names of what an action places, in order. */
export function targets(scene: Scene): string[] {
  return [...new Set((scene.action?.components ?? []).map((c) => c.target))];
}

/** The unit of what a component sets. */
export function unit(component: Component): string {
  return { x: "m", y: "m", radius: "m", angle: "rad", vx: "m/s", vy: "m/s", omega: "rad/s" }[component.set];
}
