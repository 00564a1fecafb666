// Values of action components. The server decides whether an action is valid.

import { type Component, allObjects, type Scene } from "./types";

/** Value of a component at `share` (0 to 1), SI. */
export function valueAt(component: Component, share: number): number {
  return component.low + share * (component.high - component.low);
}

/** The share at which a component has the value `target`, clamped to 0 to 1. */
export function shareFor(component: Component, target: number): number {
  const span = component.high - component.low;
  return span === 0 ? 0 : Math.min(1, Math.max(0, (target - component.low) / span));
}

/** The scene after placing an action, as far as it is displayed. */
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

/** Names of the objects that the action places, in order. */
export function targets(scene: Scene): string[] {
  return [...new Set((scene.action?.components ?? []).map((c) => c.target))];
}

/** The unit of a component. */
export function unit(component: Component): string {
  return { x: "m", y: "m", radius: "m", angle: "rad", vx: "m/s", vy: "m/s", omega: "rad/s" }[component.set];
}
