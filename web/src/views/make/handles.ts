// Handles of the selection: their positions, and the effect of dragging one.

import { allObjects, type Body, type Box, type Point, type Scene } from "../../scene/types";
import { write } from "./path";
import { distanceToSegment, distanceTo, inside, middle, toWorldFrame, halfExtent, round, rounded } from "./shapes";
import { roundedInBodyFrame, objectPaths, translated, objectAt, rotated } from "./objects";

export interface Handle {
  /** Unique within the selection. */
  id: string;
  look: "size" | "turn" | "move";
  at: Point;
  /** Tooltip. */
  about: string;
}

/** Handles of the object at a path; `gap`: distance of the rotation handle, m. */
export function handles(scene: Scene, place: string, gap: number): Handle[] {
  const object = objectAt(scene, place);
  if (object) return !object.position && place.startsWith("bodies") ? [] : [...sizeHandles(object), ...turnHandle(object, gap)];
  if (place === "goal" && scene.goal?.type === "inside") return scene.goal.region.map((at, i) => size(`${i}`, at, "Move this corner of the region"));
  if (place === "action") return placementAreas(scene).flatMap(({ id, box, about }) => rectangle(id, box, about));
  return [];
}

/** The scene after dragging a handle to a point, m. */
export function dragHandle(scene: Scene, place: string, id: string, to: Point): Scene {
  const object = objectAt(scene, place);
  if (object) return write(scene, place, id === "turn" ? turnedTowards(object, to) : resized(object, id, to));
  if (place === "goal" && scene.goal?.type === "inside") return write(scene, `goal.region[${id}]`, rounded(to));
  if (place === "action") return resizedArea(scene, id, to);
  return scene;
}

/** The scene after moving the selection, m. */
export function moveSelection(scene: Scene, place: string, by: Point): Scene {
  const object = objectAt(scene, place);
  if (object) return write(scene, place, translated(object, by));
  const shift = (p: Point): Point => rounded([p[0] + by[0], p[1] + by[1]]);
  if (place === "goal" && scene.goal?.type === "inside") return write(scene, "goal.region", scene.goal.region.map(shift));
  if (place !== "action") return scene;
  return placementAreas(scene).reduce((now, { id, box }) => placedArea(now, id, [...shift([box[0], box[1]]), ...shift([box[2], box[3]])] as Box), scene);
}

/** The selection at a point: the topmost object within `radius`, m, the goal region, or an edge of a placement area. */
export function hitTest(scene: Scene, p: Point, radius: number): string | null {
  const visible = objectPaths(scene).filter((at) => objectAt(scene, at)!.position || at.startsWith("statics"));
  // Bodies are drawn above statics, later objects above earlier ones.
  const order = [...visible.filter((at) => at.startsWith("statics")), ...visible.filter((at) => at.startsWith("bodies"))].reverse();
  const distances = order.map((at) => distanceTo(objectAt(scene, at)!, p));
  const topmost = order.find((_, i) => distances[i] === 0);
  const closest = order.filter((_, i) => distances[i]! <= radius).sort((a, b) => distances[order.indexOf(a)]! - distances[order.indexOf(b)]!)[0];
  if (topmost ?? closest) return topmost ?? closest!;
  if (placementAreas(scene).some(({ box }) => sides(box).some(([a, b]) => distanceToSegment(p, a, b) <= radius))) return "action";
  if (scene.goal?.type === "inside" && inside(scene.goal.region, p)) return "goal";
  return null;
}

/** Rectangles of possible placements, and the bounds of the action, m. */
export function placementAreas(scene: Scene): { id: string; box: Box; about: string; bounds: boolean }[] {
  const { action } = scene;
  if (!action) return [];
  const objects = new Map(allObjects(scene).map((b) => [b.name, b]));
  const targets = [...new Set(action.components.map((c) => c.target))].flatMap((target) => {
    const [x, y] = (["x", "y"] as const).map((set) => action.components.find((c) => c.target === target && c.set === set));
    if (!x && !y) return [];
    const at = objects.get(target)?.position ?? [0, 0];
    const box: Box = [x?.low ?? at[0], y?.low ?? at[1], x?.high ?? at[0], y?.high ?? at[1]];
    return [{ id: target, box, about: `where ${target} may be placed`, bounds: false }];
  });
  const { bounds } = action;
  const limits: Box | null = !bounds ? null : Array.isArray(bounds) ? bounds : [...bounds.min, ...bounds.max];
  return limits ? [...targets, { id: BOUNDS_ID, box: limits, about: "the bounds of the action", bounds: true }] : targets;
}

/** Cannot be a name: names have 1 to 100 characters. */
const BOUNDS_ID = "";

function sizeHandles(object: Body): Handle[] {
  const { shape } = object;
  const at = (p: Point): Point => toWorldFrame(object, p);
  switch (shape.type) {
    case "disc":
      return [size("radius", at([shape.radius, 0]), "Change the radius")];
    case "box": {
      const { half_width: w, half_height: h } = shape;
      const corners: Point[] = [[-w, -h], [w, -h], [w, h], [-w, h]];
      return corners.map((c, i) => size(`${i}`, at(c), "Change width and height"));
    }
    case "polygon":
      return shape.vertices.map((v, i) => size(`${i}`, at(v), "Move this corner"));
    case "segment":
      return [size("from", at(shape.from), "Move this end"), size("to", at(shape.to), "Move this end")];
    default:
      return [];
  }
}

function turnHandle(object: Body, gap: number): Handle[] {
  if (object.shape.type === "halfspace") return [];
  const [x, y] = middle(object.shape);
  return [{ id: "turn", look: "turn", at: toWorldFrame(object, [x, y + halfExtent(object.shape) + gap]), about: "Rotate" }];
}

/** The object rotated such that its rotation handle points to a position. */
function turnedTowards(object: Body, to: Point): Body {
  const at = toWorldFrame(object, middle(object.shape));
  const angle = Math.atan2(to[1] - at[1], to[0] - at[0]) - Math.PI / 2;
  return rotated(object, Math.round(nearestTurn(angle, object.angle ?? 0) * 100) / 100);
}

/** The angle modulo 2 pi that is nearest to another. */
function nearestTurn(angle: number, other: number): number {
  return angle + 2 * Math.PI * Math.round((other - angle) / (2 * Math.PI));
}

/** Minimum length after dragging, m. */
const MIN_LENGTH_M = 1e-3;

function resized(object: Body, id: string, to: Point): Body {
  const { shape } = object;
  const p = roundedInBodyFrame(object, to);
  switch (shape.type) {
    case "disc":
      return { ...object, shape: { ...shape, radius: Math.max(MIN_LENGTH_M, round(Math.hypot(p[0], p[1]))) } };
    case "box": {
      // The opposite corner stays fixed.
      const [w, h] = [shape.half_width, shape.half_height];
      const fixed: Point = ([[w, h], [-w, h], [-w, -h], [w, -h]] as Point[])[Number(id)]!;
      const half: Point = [Math.max(MIN_LENGTH_M, round(Math.abs(p[0] - fixed[0]) / 2)), Math.max(MIN_LENGTH_M, round(Math.abs(p[1] - fixed[1]) / 2))];
      const centre: Point = [fixed[0] + Math.sign(p[0] - fixed[0] || 1) * half[0], fixed[1] + Math.sign(p[1] - fixed[1] || 1) * half[1]];
      return { ...object, shape: { ...shape, half_width: half[0], half_height: half[1] }, position: rounded(toWorldFrame(object, centre)) };
    }
    case "polygon":
      return { ...object, shape: { ...shape, vertices: shape.vertices.map((v, i) => (i === Number(id) ? p : v)) } };
    case "segment":
      return { ...object, shape: { ...shape, [id]: p } };
    default:
      return object;
  }
}

function rectangle(id: string, box: Box, about: string): Handle[] {
  const corners = sides(box).map(([a], i) => size(`${i}:${id}`, a, `Change ${about}`));
  return [...corners, { id: `move:${id}`, look: "move", at: [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2], about: `Move ${about}` }];
}

function resizedArea(scene: Scene, handle: string, to: Point): Scene {
  const [which = "", ...rest] = handle.split(":");
  const id = rest.join(":");
  const box = placementAreas(scene).find((a) => a.id === id)?.box;
  if (!box) return scene;
  if (which === "move") {
    const by: Point = [to[0] - (box[0] + box[2]) / 2, to[1] - (box[1] + box[3]) / 2];
    return placedArea(scene, id, [box[0] + by[0], box[1] + by[1], box[2] + by[0], box[3] + by[1]]);
  }
  const corner = Number(which);
  const [x, y] = [corner === 0 || corner === 3 ? 0 : 2, corner < 2 ? 1 : 3] as const;
  const next: Box = [...box];
  // A corner cannot pass the opposite one.
  next[x] = x === 0 ? Math.min(to[0], box[2]) : Math.max(to[0], box[0]);
  next[y] = y === 1 ? Math.min(to[1], box[3]) : Math.max(to[1], box[1]);
  return placedArea(scene, id, next);
}

/** The scene with another placement rectangle. */
function placedArea(scene: Scene, id: string, [left, bottom, right, top]: Box): Scene {
  const { action } = scene;
  if (!action) return scene;
  const box: Box = [round(left), round(bottom), round(right), round(top)];
  if (id === BOUNDS_ID) return { ...scene, action: { ...action, bounds: box } };
  const components = action.components.map((c) => {
    if (c.target !== id || (c.set !== "x" && c.set !== "y")) return c;
    return c.set === "x" ? { ...c, low: box[0], high: box[2] } : { ...c, low: box[1], high: box[3] };
  });
  return { ...scene, action: { ...action, components } };
}

/** The edges of a box, counter-clockwise from the lower left corner. */
function sides([left, bottom, right, top]: Box): [Point, Point][] {
  const corners: Point[] = [[left, bottom], [right, bottom], [right, top], [left, top]];
  return corners.map((a, i) => [a, corners[(i + 1) % 4]!]);
}

function size(id: string, at: Point, about: string): Handle {
  return { id, look: "size", at, about };
}

