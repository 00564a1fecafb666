// Geometry of shapes: centre, scaling, conversion, distance.

import type { Body, Point, Shape } from "../../scene/types";
import { corners, toWorld } from "../../scene/extent";

/** Drawn lengths are multiples of a micrometre, so that sums have no rounding digits. */
export function round(v: number): number {
  return Math.round(v * 1e6) / 1e6;
}

export const rounded = (p: Point): Point => [round(p[0]), round(p[1])];

/** The centre of a shape's bounding box in its own frame, m. */
export function middle(shape: Shape): Point {
  const box = extent(shape);
  return box ? [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2] : [0, 0];
}

/** Half the longer side of a shape's bounding box, m. */
export function halfExtent(shape: Shape): number {
  const box = extent(shape);
  return box ? Math.max(box[2] - box[0], box[3] - box[1]) / 2 : 0;
}

/** A point of the body's frame in the world frame, m. */
export function toWorldFrame(object: Body, p: Point): Point {
  return toWorld(p, object.position ?? [0, 0], object.angle ?? 0);
}

/** A point of the world frame in the body's frame, m. */
export function toBodyFrame(object: Body, p: Point): Point {
  const [x, y] = object.position ?? [0, 0];
  return toWorld([p[0] - x, p[1] - y], [0, 0], -(object.angle ?? 0));
}

/** A shape scaled about its centre; a half plane has no size. */
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

/** A shape of another type and about the same size. */
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

/** Convex hull, counter-clockwise (Andrew 1979), without points on its edges. */
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

/** Distance of a point from an object, m; 0 inside. */
export function distanceTo(object: Body, p: Point): number {
  return distanceToShape(object.shape, toBodyFrame(object, p));
}

/** Whether a point is inside a polygon. */
export function inside(polygon: readonly Point[], p: Point): boolean {
  let odd = false;
  polygon.forEach((a, i) => {
    const b = polygon[(i + 1) % polygon.length]!;
    if (a[1] > p[1] !== b[1] > p[1] && p[0] < a[0] + ((p[1] - a[1]) / (b[1] - a[1])) * (b[0] - a[0])) odd = !odd;
  });
  return odd;
}

/** Distance of a point from a line segment, m. */
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

/** A piece of a compound scaled about the compound's origin. */
function scaledPiece<P extends Shape & { position?: Point; angle?: number }>(piece: P, factor: number): P {
  const about = toWorld(middle(piece), [0, 0], piece.angle ?? 0);
  const resized = scaled(piece, factor);
  const [x, y] = piece.position ?? [0, 0];
  // `scaled` keeps the centre of the piece; the remaining displacement is added to its position.
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
