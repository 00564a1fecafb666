// Mechanisms (`iplw.scene/2`): joints between bodies, and where joint positions put the bodies.

import type { Body, Box, Point, Pose } from "../../scene/types";

export interface Joint {
  name: string;
  kind: "revolute" | "prismatic";
  body: string;
  /** The body that it hangs on; the world if absent. */
  parent?: string | null;
  anchor: Point;
  axis?: Point | null;
  position?: number;
  velocity?: number;
  armature?: number;
  spring?: { stiffness: number; damping?: number; rest?: number } | null;
  effects?: { name: string; parameters?: Record<string, number> }[];
}

/** A scene with joints and motors. */
export interface Mechanism {
  name?: string;
  bodies: Body[];
  joints: Joint[];
  motors?: { joint: string; control: string; max_torque?: number }[];
  [more: string]: unknown;
}

/** The frame of a joint's body: where its anchor is, m, and its angle, rad. */
interface Frame {
  origin: Point;
  angle: number;
}

/** Parses a scene file; `null` if it has no joints. */
export function mechanismOf(value: unknown): Mechanism | null {
  const scene = value as Partial<Mechanism> | null;
  return scene && Array.isArray(scene.joints) && scene.joints.length > 0 && Array.isArray(scene.bodies) ? (scene as Mechanism) : null;
}

/** Unit of a joint's positions. */
export function unit(joint: Joint): string {
  return joint.kind === "revolute" ? "rad" : "m";
}

/** Frames of all joints at their positions, by name of the joint. */
export function frames(scene: Mechanism, positions: Readonly<Record<string, number>>): Map<string, Frame> {
  const out = new Map<string, Frame>();
  const frame = (joint: Joint): Frame => {
    const cached = out.get(joint.name);
    if (cached) return cached;
    const parent = scene.joints.find((other) => other.body === joint.parent);
    const on: Frame = parent ? frame(parent) : { origin: [0, 0], angle: 0 };
    const from = parent ? parent.anchor : ([0, 0] as Point);
    const q = positions[joint.name] ?? joint.position ?? 0;
    const axis = joint.axis ?? [0, 0];
    const length = Math.hypot(...axis) || 1;
    const shift = joint.kind === "prismatic" ? q / length : 0;
    const arm: Point = [joint.anchor[0] - from[0] + shift * axis[0], joint.anchor[1] - from[1] + shift * axis[1]];
    const own = { origin: moved(on, arm), angle: on.angle + (joint.kind === "revolute" ? q : 0) };
    out.set(joint.name, own);
    return own;
  };
  scene.joints.forEach(frame);
  return out;
}

/** Poses of the bodies at joint positions. */
export function poses(scene: Mechanism, positions: Readonly<Record<string, number>>): Map<string, Pose> {
  const all = frames(scene, positions);
  return new Map(
    scene.joints.flatMap((joint) => {
      const body = scene.bodies.find((b) => b.name === joint.body);
      const frame = all.get(joint.name);
      if (!body?.position || !frame) return [];
      const [x, y] = moved(frame, [body.position[0] - joint.anchor[0], body.position[1] - joint.anchor[1]]);
      return [[body.name, { x, y, angle: (body.angle ?? 0) + frame.angle }] as const];
    }),
  );
}

/** A box around all that hinges can reach, and what slides reach at these positions; m. */
export function reach(scene: Mechanism, slides: Readonly<Record<string, readonly number[]>>): Box {
  const radius = scene.bodies.reduce((sum, b) => {
    const joint = scene.joints.find((j) => j.body === b.name);
    const arm = joint && b.position ? 2 * Math.hypot(b.position[0] - joint.anchor[0], b.position[1] - joint.anchor[1]) : 0;
    return sum + arm;
  }, 0.25);
  const roots = scene.joints.filter((j) => !j.parent);
  const ends = roots.flatMap((j) => {
    const shifts = j.kind === "prismatic" ? [Math.min(-0.5, ...(slides[j.name] ?? [])), Math.max(0.5, ...(slides[j.name] ?? []))] : [0];
    const axis = j.axis ?? [0, 0];
    return shifts.map((q): Point => [j.anchor[0] + q * axis[0], j.anchor[1] + q * axis[1]]);
  });
  const [xs, ys] = [ends.map((p) => p[0]), ends.map((p) => p[1])];
  return [Math.min(...xs) - radius, Math.min(...ys) - radius, Math.max(...xs) + radius, Math.max(...ys) + radius];
}

function moved(frame: Frame, [x, y]: Point): Point {
  const [sin, cos] = [Math.sin(frame.angle), Math.cos(frame.angle)];
  return [frame.origin[0] + cos * x - sin * y, frame.origin[1] + sin * x + cos * y];
}
