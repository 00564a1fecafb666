// Operations on objects of a scene by their path (`bodies[0]`, `statics[2]`): add, remove, rename, move, rotate. Scenes are
// immutable; other parts are kept.

import { type Body, allObjects, type Point, type Scene } from "../../scene/types";
import { write } from "./path";
import { convertShape, toBodyFrame, middle, toWorldFrame, round, rounded } from "./shapes";

/** The object at a path; `null` if there is none. */
export function objectAt(scene: Scene, place: string): Body | null {
  const [, list, index] = /^(bodies|statics)\[(\d+)\]$/.exec(place) ?? [];
  if (!list) return null;
  return (list === "bodies" ? scene.bodies : (scene.statics ?? []))[Number(index)] ?? null;
}

/** Paths of all objects: bodies, then statics. */
export function objectPaths(scene: Scene): string[] {
  return [...scene.bodies.map((_, i) => `bodies[${i}]`), ...(scene.statics ?? []).map((_, i) => `statics[${i}]`)];
}

/** Whether the object at a path is a body. */
export function isBody(place: string): boolean {
  return place.startsWith("bodies");
}

/** Adds an object with a unique name; returns its path. */
export function addObject(scene: Scene, object: Body, moving: boolean): { scene: Scene; place: string } {
  const list = moving ? "bodies" : "statics";
  const place = `${list}[${(scene[list] ?? []).length}]`;
  return { scene: write(scene, place, { ...object, name: uniqueName(scene, object.name) }), place };
}

/** Removes an object with its action components, overrides, and a goal that names it. */
export function removeObject(scene: Scene, place: string): Scene {
  const removedName = objectAt(scene, place)?.name;
  if (removedName === undefined) return scene;
  let next = write(scene, place, undefined);
  if (goalNames(next).includes(removedName)) next = write(next, "goal", undefined);
  if (next.action) next = setComponents(next, next.action.components.map((c) => (c.target === removedName ? null : c)));
  if (next.carriers?.includes(removedName)) next = { ...next, carriers: next.carriers.filter((n) => n !== removedName) };
  return renameOverrides(next, (name) => (name === removedName ? null : name));
}

/** Duplicates an object, shifted; returns the path of the copy. */
export function duplicateObject(scene: Scene, place: string, aside: number): { scene: Scene; place: string } {
  const object = objectAt(scene, place);
  if (!object) return { scene, place };
  return addObject(scene, translated(structuredClone(object), [aside, aside]), isBody(place));
}

/** Renames an object and all references to it; returns a message if another object has the name, because references would become
 * ambiguous. */
export function renameObject(scene: Scene, place: string, name: string): Scene | string {
  const old = objectAt(scene, place)?.name;
  if (old === undefined || old === name) return scene;
  if (allObjects(scene).some((b) => b.name === name)) return `Another object is named "${name}".`;
  const now = (n: string): string => (n === old ? name : n);
  let next = write(scene, `${place}.name`, name);
  const shared = allObjects(scene).filter((b) => b.name === old).length > 1;
  if (shared) return next;
  if (next.goal && "bodies" in next.goal) next = { ...next, goal: { ...next.goal, bodies: [now(next.goal.bodies[0]), now(next.goal.bodies[1])] } };
  if (next.goal && "body" in next.goal) next = { ...next, goal: { ...next.goal, body: now(next.goal.body) } };
  if (next.action) next = setComponents(next, next.action.components.map((c) => (c.target === old ? { ...c, target: name } : c)));
  if (next.carriers) next = { ...next, carriers: next.carriers.map(now) };
  return renameOverrides(next, now);
}

/** Converts a body to a static or a static to a body, without the fields that the other kind lacks; returns its new path. */
export function convertObject(scene: Scene, place: string): { scene: Scene; place: string } {
  const object = objectAt(scene, place);
  if (!object) return { scene, place };
  const moving = !isBody(place);
  const { velocity: _v, angular_velocity: _w, mass: _m, density: _d, ...rest } = object;
  const convertedBody: Body = moving ? { ...rest, shape: movableShape(object), position: object.position ?? [0, 0] } : { ...rest, position: object.position ?? [0, 0] };
  const list = moving ? "bodies" : "statics";
  const without = write(scene, place, undefined);
  return { scene: write(without, `${list}[${(without[list] ?? []).length}]`, convertedBody), place: `${list}[${(without[list] ?? []).length}]` };
}

/** The object translated, m. */
export function translated(object: Body, by: Point): Body {
  const { shape } = object;
  if (shape.type === "halfspace") {
    const offset = round(shape.offset + shape.normal[0] * by[0] + shape.normal[1] * by[1]);
    return { ...object, shape: { ...shape, offset } };
  }
  const [x, y] = object.position ?? [0, 0];
  return { ...object, position: rounded([x + by[0], y + by[1]]) };
}

/** The object rotated to an angle, rad, about its centre; a half plane about its point nearest to the origin. */
export function rotated(object: Body, angle: number): Body {
  const { shape } = object;
  if (shape.type === "halfspace") {
    const by = angle - (object.angle ?? 0);
    const [x, y] = shape.normal;
    const [sin, cos] = [Math.sin(by), Math.cos(by)];
    return { ...object, shape: { ...shape, normal: rounded([x * cos - y * sin, x * sin + y * cos]) } };
  }
  const centre = middle(shape);
  const was = toWorldFrame(object, centre);
  const now = toWorldFrame({ ...object, angle }, centre);
  return translated({ ...object, angle: round(angle) }, [was[0] - now[0], was[1] - now[1]]);
}

/** The object with its origin moved to its centre, at the same place, so that its angle rotates it about its centre. */
export function recentred(object: Body): Body {
  const { shape } = object;
  const centre = middle(shape);
  if (shape.type !== "polygon" && shape.type !== "segment") return object;
  const back = (p: Point): Point => rounded([p[0] - centre[0], p[1] - centre[1]]);
  const recentredShape = shape.type === "polygon" ? { ...shape, vertices: shape.vertices.map(back) } : { ...shape, from: back(shape.from), to: back(shape.to) };
  return { ...object, shape: recentredShape, position: rounded(toWorldFrame(object, centre)) };
}

/** A world point in the object's frame, rounded. */
export function roundedInBodyFrame(object: Body, p: Point): Point {
  return rounded(toBodyFrame(object, p));
}

/** Names of the bodies of the goal. */
export function goalNames(scene: Scene): string[] {
  if (!scene.goal) return [];
  return "bodies" in scene.goal ? scene.goal.bodies : [scene.goal.body];
}

/** The scene with other action components, `null` to remove one; updates grid counts, and removes the action if no component is
 * left. */
export function setComponents(scene: Scene, list: readonly (NonNullable<Scene["action"]>["components"][number] | null)[]): Scene {
  const { action } = scene;
  if (!action) return scene;
  const convertedBody = list.filter((c) => c !== null);
  if (!convertedBody.length) return write(scene, "action", undefined);
  const next = { ...action, components: convertedBody };
  const { discrete } = action;
  if (discrete?.type !== "grid") return { ...scene, action: next };
  const counts = list.flatMap((c, i) => (c === null ? [] : [discrete.counts[i] ?? DEFAULT_GRID_CELLS]));
  return { ...scene, action: { ...next, discrete: { ...discrete, counts } } };
}

/** Grid cells along a new component. */
const DEFAULT_GRID_CELLS = 10;

function uniqueName(scene: Scene, stem: string): string {
  const names = new Set(allObjects(scene).map((b) => b.name));
  const plain = stem.replace(/ \d+$/, "");
  for (let i = 1; ; i++) {
    const name = i === 1 ? plain : `${plain} ${i}`;
    if (!names.has(name)) return name;
  }
}

/** The shape for a body: bounded, and with a thickness. */
function movableShape(object: Body): Body["shape"] {
  const { shape } = object;
  if (shape.type === "halfspace") return convertShape(shape, "box");
  if (shape.type === "segment" && !shape.radius) return { ...shape, radius: round(Math.hypot(shape.to[0] - shape.from[0], shape.to[1] - shape.from[1]) / 40) };
  return shape;
}

/** Renames overrides by setting; `null` removes one. */
function renameOverrides(scene: Scene, now: (name: string) => string | null): Scene {
  const settings = scene.settings as Record<string, Record<string, Record<string, unknown>>> | undefined;
  if (!settings) return scene;
  const names = (of: Record<string, unknown>): Record<string, unknown> =>
    Object.fromEntries(Object.entries(of).flatMap(([name, v]) => (now(name) === null ? [] : [[now(name)!, v]])));
  const each = Object.entries(settings).map(([setting, lists]) => [
    setting,
    Object.fromEntries(Object.entries(lists).map(([list, of]) => [list, names(of)])),
  ]);
  return { ...scene, settings: Object.fromEntries(each) as unknown };
}
