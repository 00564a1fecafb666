// The displayed part of `iplw.scene/1` (docs/reference/formats.md). SI; y up; angles counter-clockwise.

export type Point = [number, number];

export type Shape =
  | { type: "disc"; radius: number }
  | { type: "box"; half_width: number; half_height: number }
  | { type: "polygon"; vertices: Point[] }
  | { type: "segment"; from: Point; to: Point; radius?: number }
  | { type: "halfspace"; normal: Point; offset: number }
  | { type: "compound"; pieces: (Shape & { position?: Point; angle?: number })[] };

export interface Body {
  name: string;
  shape: Shape;
  position?: Point | null;
  angle?: number;
  velocity?: Point;
  angular_velocity?: number;
  density?: number;
  mass?: number;
  friction?: number;
  restitution?: number;
}

export type Goal =
  | { type: "contact"; bodies: [string, string]; hold_s?: number; tolerance?: number; stop?: boolean }
  | { type: "apart"; bodies: [string, string]; after_touch?: boolean; hold_s?: number; tolerance?: number; stop?: boolean }
  | { type: "inside"; body: string; region: Point[]; hold_s?: number; stop?: boolean }
  | { type: "above"; body: string; height?: number; line?: [Point, Point]; point?: "lowest" | "centre"; hold_s?: number; stop?: boolean };

export interface Component {
  target: string;
  set: "x" | "y" | "radius" | "angle" | "vx" | "vy" | "omega";
  low: number;
  high: number;
}

/** Left, bottom, right, top; m. */
export type Box = [number, number, number, number];

/** Discretisation of the action space. */
export type Discrete = { type: "sequence"; count: number } | { type: "grid"; counts: number[] };

export interface Scene {
  format: "iplw.scene/1";
  name?: string;
  gravity?: Point;
  bodies: Body[];
  statics?: Body[];
  goal?: Goal | null;
  action?: { components: Component[]; bounds?: Box | { min: Point; max: Point } | null; discrete?: Discrete } | null;
  time_step?: number;
  steps?: number;
  observe_every?: number;
  damping?: number;
  stop?: boolean;
  carriers?: string[];
  effects?: { name: string; parameters?: Record<string, number> }[];
  contact_rules?: { restitution_threshold?: number; [more: string]: unknown };
  [more: string]: unknown;
}

/** Pose of a body: m, m, rad. */
export interface Pose {
  x: number;
  y: number;
  angle: number;
}

/** Bodies and statics. */
export function allObjects(scene: Scene): Body[] {
  return [...scene.bodies, ...(scene.statics ?? [])];
}
