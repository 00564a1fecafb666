// The visible part of the world.

import type { Body, Box, Goal, Point, Scene, Shape } from "./types";

/** Statics extend the box by at most this share of its size; longer ones are clipped. */
const MAX_STATIC_SHARE = 0.25;
const MARGIN = 0.02;
/** The box is at least this many times as wide, and as high, as its largest body is thick. */
const [MIN_WIDTH_BODIES, MIN_HEIGHT_BODIES] = [5, 3];
/** Floors are visible below bodies up to this many body sizes away. */
const MAX_FLOOR_BODIES = 40;
/** A path extends the box by at most this many times its size. */
const MAX_PATH_SHARE = 4;

/** The visible box, m: bodies with some surroundings, goal, action bounds, and nearby statics. */
export function sceneExtent(scene: Scene, also: readonly Point[] = []): Box {
  const points: Point[] = [...also];
  for (const body of scene.bodies) if (body.position) points.push(...corners(body.shape, body.position, body.angle ?? 0), ...floors(scene, body));
  if (scene.goal?.type === "inside") points.push(...scene.goal.region);
  if (scene.goal?.type === "above") points.push(...goalLinePoint(scene, scene.goal));
  const bounds = scene.action?.bounds;
  if (bounds) points.push(...(Array.isArray(bounds) ? ends(bounds) : [bounds.min, bounds.max]));
  let box = around(points) ?? [-1, -1, 1, 1];
  const size = Math.max(box[2] - box[0], box[3] - box[1], 1e-3);
  const reach: Box = [box[0] - MAX_STATIC_SHARE * size, box[1] - MAX_STATIC_SHARE * size, box[2] + MAX_STATIC_SHARE * size, box[3] + MAX_STATIC_SHARE * size];
  for (const object of scene.statics ?? []) {
    if (object.shape.type === "halfspace") continue;
    const objectBox = around(corners(object.shape, object.position ?? [0, 0], object.angle ?? 0));
    if (!objectBox) continue;
    const near: Box = [Math.max(objectBox[0], reach[0]), Math.max(objectBox[1], reach[1]), Math.min(objectBox[2], reach[2]), Math.min(objectBox[3], reach[3])];
    if (near[0] <= near[2] && near[1] <= near[3]) box = join(box, near);
  }
  const thickness = Math.max(0, ...scene.bodies.map(bodyThickness));
  box = atLeast(box, MIN_WIDTH_BODIES * thickness, MIN_HEIGHT_BODIES * thickness);
  const pad = MARGIN * Math.max(box[2] - box[0], box[3] - box[1], 1e-3);
  return [box[0] - pad, box[1] - pad, box[2] + pad, box[3] + pad];
}

/** The corners of a path's bounding box with a margin, m, as far as the path is not many times the size of `box` away from it. */
export function pathCorners(path: readonly Point[], margin: number, box: Box): Point[] {
  const size = MAX_PATH_SHARE * Math.max(box[2] - box[0], box[3] - box[1]);
  const clamp = (v: number, low: number, high: number): number => Math.min(high + size, Math.max(low - size, v));
  const reached = around(path.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y)));
  if (!reached) return [];
  const [left, bottom, right, top] = reached;
  const corner = (x: number, y: number): Point => [clamp(x, box[0], box[2]), clamp(y, box[1], box[3])];
  return [corner(left - margin, bottom - margin), corner(right + margin, top + margin)];
}

/** A box enlarged about its centre to an aspect ratio, width to height. */
export function withAspect(box: Box, aspect: number): Box {
  const height = Math.max(box[3] - box[1], (box[2] - box[0]) / aspect);
  return atLeast(box, aspect * height, height);
}

/** Extreme points of a shape, in the world frame. */
export function corners(shape: Shape, position: Point, angle: number): Point[] {
  const at = (p: Point): Point => toWorld(p, position, angle);
  const about = (p: Point, r: number): Point[] => [[p[0] - r, p[1] - r], [p[0] + r, p[1] + r]];
  switch (shape.type) {
    case "disc":
      return about(position, shape.radius);
    case "box": {
      const { half_width: w, half_height: h } = shape;
      return ([[-w, -h], [w, -h], [w, h], [-w, h]] as Point[]).map(at);
    }
    case "polygon":
      return shape.vertices.map(at);
    case "segment":
      return [shape.from, shape.to].flatMap((p) => about(at(p), shape.radius ?? 0));
    case "compound":
      return shape.pieces.flatMap((p) => corners(p, at(p.position ?? [0, 0]), angle + (p.angle ?? 0)));
    case "halfspace":
      return [];
  }
}

/** A point of a body's frame in the world frame. */
export function toWorld(p: Point, position: Point, angle: number): Point {
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  return [position[0] + p[0] * cos - p[1] * sin, position[1] + p[0] * sin + p[1] * cos];
}

/** The point of the goal's line above the body's start, if it has one. */
function goalLinePoint(scene: Scene, goal: Extract<Goal, { type: "above" }>): Point[] {
  const at = scene.bodies.find((b) => b.name === goal.body)?.position;
  const [[ax, ay], [bx, by]] = goalLine(goal);
  return at && ax !== bx ? [[at[0], ay + ((at[0] - ax) / (bx - ax)) * (by - ay)]] : [];
}

/** Two points of the goal's line. */
export function goalLine(goal: Extract<Goal, { type: "above" }>): [Point, Point] {
  return goal.line ?? [[0, goal.height ?? 0], [1, goal.height ?? 0]];
}

/** The part of the half plane `normal . p <= offset` inside a box, as a polygon. */
export function halfPlane(normal: Point, offset: number, box: Box): Point[] {
  const inside = (p: Point): number => offset - normal[0] * p[0] - normal[1] * p[1];
  const square: Point[] = [[box[0], box[1]], [box[2], box[1]], [box[2], box[3]], [box[0], box[3]]];
  return square.flatMap((p, i) => {
    const q = square[(i + 1) % 4]!;
    const [a, b] = [inside(p), inside(q)];
    const vertices: Point[] = a >= 0 ? [p] : [];
    if (a >= 0 !== b >= 0) {
      const s = a / (a - b);
      vertices.push([p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])]);
    }
    return vertices;
  });
}

/** The points of half planes below a body that are nearest to it. */
function floors(scene: Scene, body: Body): Point[] {
  const [x, y] = body.position!;
  const reach = MAX_FLOOR_BODIES * bodyThickness(body);
  return (scene.statics ?? []).flatMap(({ shape }): Point[] => {
    if (shape.type !== "halfspace") return [];
    const { normal: [nx, ny], offset } = shape;
    const above = (nx * x + ny * y - offset) / (nx * nx + ny * ny);
    return Math.abs(above) * Math.hypot(nx, ny) <= reach ? [[x - above * nx, y - above * ny]] : [];
  });
}

/** The smaller side of a body's bounding box, m. */
export function bodyThickness(body: Body): number {
  const box = around(corners(body.shape, [0, 0], 0));
  return box ? Math.min(box[2] - box[0], box[3] - box[1]) : 0;
}

/** A box enlarged about its centre to a minimum size. */
function atLeast(box: Box, width: number, height: number): Box {
  const [x, y] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const [w, h] = [Math.max(box[2] - box[0], width) / 2, Math.max(box[3] - box[1], height) / 2];
  return [x - w, y - h, x + w, y + h];
}

/** The bounding box of points. */
export function around(points: readonly Point[]): Box | null {
  if (!points.length) return null;
  const [x, y] = [points.map((p) => p[0]), points.map((p) => p[1])];
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
}

function join(a: Box, b: Box): Box {
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])];
}

function ends(box: Box): Point[] {
  return [[box[0], box[1]], [box[2], box[3]]];
}
