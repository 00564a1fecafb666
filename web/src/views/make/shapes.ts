// Shapes as they are edited: where their middle is, made larger, turned into one another, whether a point is on them.

import type { Body, Point, Shape } from "../../scene/types";
import { corners, toWorld } from "../../scene/extent";

/** Lengths of what is drawn are multiples of a millionth: sums leave no tails of digits. */
export function round(v: number): number {
  return Math.round(v * 1e6) / 1e6;
}

export const rounded = (p: Point): Point => [round(p[0]), round(p[1])];

/** The middle of a shape in its own frame, m: the middle of the box around it. */
export function middle(shape: Shape): Point {
  const box = extent(shape);
  return box ? [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2] : [0, 0];
}

/** Half the larger side of the box around a shape, m. */
export function halfExtent(shape: Shape): number {
  const box = extent(shape);
  return box ? Math.max(box[2] - box[0], box[3] - box[1]) / 2 : 0;
}

/** A place of a thing's own frame in the world, m. */
export function toWorldFrame(object: Body, p: Point): Point {
  return toWorld(p, object.position ?? [0, 0], object.angle ?? 0);
}

/** A place of the world in a thing's own frame, m. */
export function toBodyFrame(object: Body, p: Point): Point {
  const [x, y] = object.position ?? [0, 0];
  return toWorld([p[0] - x, p[1] - y], [0, 0], -(object.angle ?? 0));
}

/** A shape made larger about its middle; a half plane has no size. */
export function scaled(shape: Shape, factor: number): Shape {
  const about = middle(shape);
  const point = (p: Point): Point => rounded([about[0] + factor * (p[0] - about[0]), about[1] + factor * (p[1] - about[1])]);
  switch (shape.type) {
    case "disc":
      return { ...shape, radius: round(shape.radius * factor) };
    case "box":
      return { ...shape, half_width: round(shape.half_width * factor), half_height: round(shape.half_height * factor) };
    case "polygon":
      return { ...shape, vertices: shape.vertices.map(point) };
    case "segment":
      return { ...shape, from: point(shape.from), to: point(shape.to) };
    case "compound":
      return { ...shape, pieces: shape.pieces.map((p) => scaledPiece(p, factor)) };
    case "halfspace":
      return shape;
  }
}

/** A shape of another type, of about the same size. */
export function convertShape(shape: Shape, type: Shape["type"]): Shape {
  if (shape.type === type) return shape;
  const [x, y] = middle(shape);
  const r = round(halfExtent(shape) || 1);
  const box = extent(shape) ?? [x - r, y - r, x + r, y + r];
  const [w, h] = [round((box[2] - box[0]) / 2) || r, round((box[3] - box[1]) / 2) || round(r / 10)];
  switch (type) {
    case "disc":
      return { type, radius: r };
    case "box":
      return { type, half_width: w, half_height: h };
    case "polygon":
      return { type, vertices: ([[x - w, y - h], [x + w, y - h], [x + w, y + h], [x - w, y + h]] as Point[]).map(rounded) };
    case "segment":
      return { type, from: rounded([x - r, y]), to: rounded([x + r, y]), radius: round(Math.min(h, r / 10)) };
    case "halfspace":
      return { type, normal: [0, 1], offset: round(y) };
    case "compound":
      return { type, pieces: [shape as Shape] };
  }
}

/** The convex hull of points, counter-clockwise (Andrew 1979); points on its sides are left out. */
export function hull(points: readonly Point[]): Point[] {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (list: Point[]): Point[] => {
    const chain: Point[] = [];
    for (const p of list) {
      while (chain.length > 1 && cross(chain.at(-2)!, chain.at(-1)!, p) <= 1e-12) chain.pop();
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/** How far a point is from a thing, m; 0 within it. */
export function distanceTo(object: Body, p: Point): number {
  return distanceToShape(object.shape, toBodyFrame(object, p));
}

/** Whether a point is within a polygon. */
export function inside(polygon: readonly Point[], p: Point): boolean {
  let odd = false;
  polygon.forEach((a, i) => {
    const b = polygon[(i + 1) % polygon.length]!;
    if (a[1] > p[1] !== b[1] > p[1] && p[0] < a[0] + ((p[1] - a[1]) / (b[1] - a[1])) * (b[0] - a[0])) odd = !odd;
  });
  return odd;
}

/** How far a point is from the line between two others, m. */
export function distanceToSegment(p: Point, a: Point, b: Point): number {
  const [x, y] = [b[0] - a[0], b[1] - a[1]];
  const size = x * x + y * y;
  const t = size > 0 ? Math.min(1, Math.max(0, ((p[0] - a[0]) * x + (p[1] - a[1]) * y) / size)) : 0;
  return Math.hypot(p[0] - a[0] - t * x, p[1] - a[1] - t * y);
}

function distanceToShape(shape: Shape, p: Point): number {
  switch (shape.type) {
    case "disc":
      return Math.max(0, Math.hypot(p[0], p[1]) - shape.radius);
    case "box":
      return Math.hypot(Math.max(0, Math.abs(p[0]) - shape.half_width), Math.max(0, Math.abs(p[1]) - shape.half_height));
    case "polygon": {
      const { vertices: v } = shape;
      return inside(v, p) ? 0 : Math.min(...v.map((a, i) => distanceToSegment(p, a, v[(i + 1) % v.length]!)));
    }
    case "segment":
      return Math.max(0, distanceToSegment(p, shape.from, shape.to) - (shape.radius ?? 0));
    case "halfspace":
      return Math.max(0, shape.normal[0] * p[0] + shape.normal[1] * p[1] - shape.offset);
    case "compound":
      return Math.min(...shape.pieces.map((piece) => distanceTo({ name: "", shape: piece, position: piece.position ?? [0, 0], angle: piece.angle ?? 0 }, p)));
  }
}

/** A piece of a compound made larger about the compound's origin. */
function scaledPiece<P extends Shape & { position?: Point; angle?: number }>(piece: P, factor: number): P {
  const about = toWorld(middle(piece), [0, 0], piece.angle ?? 0);
  const resized = scaled(piece, factor);
  const [x, y] = piece.position ?? [0, 0];
  // `scaled` keeps the middle of the piece where it is: what that leaves of the way outwards goes to its position.
  const position = rounded([factor * x + (factor - 1) * about[0], factor * y + (factor - 1) * about[1]]);
  return { ...resized, ...(position[0] || position[1] || piece.position ? { position } : {}) } as P;
}

function extent(shape: Shape): [number, number, number, number] | null {
  const points = corners(shape, [0, 0], 0);
  if (!points.length) return null;
  const [x, y] = [points.map((p) => p[0]), points.map((p) => p[1])];
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
}

function cross(a: Point, b: Point, c: Point): number {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}
