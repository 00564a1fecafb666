// Placement of an action in a scene by pointer, keyboard and sliders; invalid positions are shaded.

import { api, ok } from "../../api/client";
import { h, put, set } from "../../dom";
import { latest } from "../../parts/latest";
import { short, slider, type Slider } from "../../parts/slider";
import { applyAction, shareFor, targets, unit, valueAt } from "../../scene/action";
import type { Picture } from "../../scene/draw";
import { around, corners } from "../../scene/extent";
import { allObjects, type Component, type Point, type Scene } from "../../scene/types";
import type { Viewport } from "../../scene/viewport";
import type { Context } from "../../view";
import { withHelp } from "./help";
import { pointerInput } from "./pointer";

/** Cells of the map of invalid positions in each direction; one request may hold 4096 actions. */
const MAP_CELLS = 48;
/** Step of a key, share of the range; finer with Ctrl. */
const [STEP_SHARE, FINE_STEP_SHARE] = [0.02, 0.002];

/** Descriptions of the components of an action. */
const ABOUT: Record<Component["set"], string> = {
  x: "Position to the right.",
  y: "Position upwards.",
  radius: "Size of the disc.",
  angle: "Rotation, counter-clockwise.",
  vx: "Initial velocity to the right.",
  vy: "Initial velocity upwards.",
  omega: "Initial spin, counter-clockwise.",
};

export interface Placement {
  element: HTMLElement;
  action: () => number[];
  /** Displays why the action is invalid; `null` if it is valid. */
  showReason: (reason: string | null) => void;
}

/** Subject of a request: a task id or a scene. */
export type SimulationSubject = { task: string } | { scene: Record<string, never> };

/** A picture in a view, and the path of the invalid positions in it. */
export interface PlacementStage {
  picture: Picture;
  view: Viewport;
  shade: SVGPathElement;
}

/** Adds placement to a picture in a view; `onMove` is called with every new action and once at the start, with `first` if given. */
export function actionPlacement(scene: Scene, subject: SimulationSubject, { picture: at, view, shade }: PlacementStage, onMove: (action: number[]) => void, context: Context, first: readonly number[] | null = null): Placement {
  const components = scene.action?.components ?? [];
  const names = targets(scene);
  let active = names[0] ?? "";
  const action = components.map(() => 0.5);
  const message = h("p", { class: "soft", role: "status" });
  const sliders: Slider[] = components.map((c, i) => {
    const text = (now: number): string => short(valueAt(c, now), unit(c));
    return slider(`${c.target} ${c.set}`, 0.5, text, (now) => change([[i, now]], c.target));
  });
  const map = latest<null>(async () => {
    await updateMap(scene, subject, action, axes(components, active), shade, context).catch(context.fail);
  });
  const axis = (set: Component["set"]): number => components.findIndex((c) => c.target === active && c.set === set);
  const change = (values: [number, number][], target = active): void => {
    // The map of an object depends on all components except its own position.
    const targetAxes = axes(components, target);
    const stale = target !== active || values.some(([i]) => i !== targetAxes.x && i !== targetAxes.y);
    active = target;
    for (const [i, now] of values) {
      action[i] = Math.min(1, Math.max(0, now));
      sliders[i]!.show(action[i]!);
    }
    if (stale) map(null);
    onMove([...action]);
  };
  const to = (p: Point): void => {
    const [x, y] = [axis("x"), axis("y")];
    const values: [number, number][] = [];
    if (x >= 0) values.push([x, shareFor(components[x]!, p[0])]);
    if (y >= 0) values.push([y, shareFor(components[y]!, p[1])]);
    if (values.length) change(values);
  };
  const place = (p: Point, begin: boolean): void => {
    if (begin) {
      active = nearest(scene, action, names)(p);
      map(null);
    }
    to(p);
  };
  pointerInput(at, view, components.length ? { hits: (p, reach) => hits(scene, action, names, p, reach), place } : null);
  keyboardInput(at.svg, components, action, () => active, (name) => (active = name), names, change);
  const start = async (): Promise<void> => {
    if (first?.length === action.length && first.every(Number.isFinite)) {
      change(first.map((v, i) => [i, v]));
      return map(null);
    }
    const free = await updateMap(scene, subject, action, axes(components, active), shade, context);
    const { x, y } = axes(components, active);
    if (free) change([[x, free[0]] as [number, number], [y, free[1]] as [number, number]].filter(([i]) => i >= 0));
    else onMove([...action]);
  };
  if (components.length) start().catch(context.fail);
  else onMove([]);
  const showReason = (reason: string | null): void => {
    set(message, { class: reason ? "refused-why" : "soft" });
    put(message, reason ? `Cannot be placed here: ${reason}.` : components.length ? "Click in the scene to place, drag the object, or use the arrow keys." : "The scene has no action: bodies start where it says. Change the latents or effects, or add an action in Make.");
  };
  showReason(null);
  return { element: h("div", { class: "stack" }, message, ...sliders.map((one, i) => withHelp(one.element, ABOUT[components[i]!.set]))), action: () => [...action], showReason };
}

/** Indices of the components that set an object's position; -1 if there is none. */
function axes(components: readonly Component[], target: string): { x: number; y: number } {
  const of = (set: string): number => components.findIndex((c) => c.target === target && c.set === set);
  return { x: of("x"), y: of("y") };
}

/** Shades invalid positions; returns the nearest valid position, or `null` if the current one is valid. */
async function updateMap(
  scene: Scene,
  subject: SimulationSubject,
  action: readonly number[],
  { x, y }: { x: number; y: number },
  shade: SVGPathElement,
  context: Context,
): Promise<[number, number] | null> {
  const [columns, rows] = [x < 0 ? 1 : MAP_CELLS, y < 0 ? 1 : MAP_CELLS];
  const cells: [number, number][] = [];
  for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) cells.push([(column + 0.5) / columns, (row + 0.5) / rows]);
  const actions = cells.map(([u, v]) => action.map((old, i) => (i === x ? u : i === y ? v : old)));
  const { reasons } = await ok(api.POST("/v1/place", { body: { ...subject, actions: [[...action], ...actions] }, signal: context.signal }));
  const free = reasons.slice(1).map((r) => r === null);
  set(shade, { d: x < 0 || y < 0 ? "" : forbiddenPath(scene, x, y, free, columns) });
  if (reasons[0] === null) return null;
  const current = [action[x] ?? 0.5, action[y] ?? 0.5] as const;
  const distance = ([u, v]: [number, number]): number => (u - current[0]) ** 2 + (v - current[1]) ** 2;
  return cells.filter((_, k) => free[k]).sort((a, b) => distance(a) - distance(b))[0] ?? null;
}

/** The invalid cells as one path, m; neighbours in a row are merged. */
function forbiddenPath(scene: Scene, x: number, y: number, free: readonly boolean[], columns: number): string {
  const components = scene.action!.components;
  const [cx, cy] = [components[x]!, components[y]!];
  const rows = free.length / columns;
  const pieces: string[] = [];
  for (let row = 0; row < rows; row++) {
    for (let from = 0; from < columns; ) {
      if (free[row * columns + from]) {
        from += 1;
        continue;
      }
      let to = from;
      while (to < columns && !free[row * columns + to]) to += 1;
      const [left, right] = [valueAt(cx, from / columns), valueAt(cx, to / columns)];
      const [bottom, top] = [valueAt(cy, row / rows), valueAt(cy, (row + 1) / rows)];
      pieces.push(`M${left} ${bottom}H${right}V${top}H${left}Z`);
      from = to;
    }
  }
  return pieces.join("");
}

/** The placeable object nearest to a point. */
function nearest(scene: Scene, action: readonly number[], names: readonly string[]): (p: Point) => string {
  const objects = allObjects(applyAction(scene, action)).filter((b) => names.includes(b.name));
  return (p) => {
    const distance = (q: Point | null | undefined): number => (q ? Math.hypot(q[0] - p[0], q[1] - p[1]) : Infinity);
    return objects.sort((a, b) => distance(a.position) - distance(b.position))[0]?.name ?? "";
  };
}

/** Whether a placeable object is within reach of a point. */
function hits(scene: Scene, action: readonly number[], names: readonly string[], [x, y]: Point, reach: number): boolean {
  return allObjects(applyAction(scene, action)).some((b) => {
    const box = names.includes(b.name) && b.position ? around(corners(b.shape, b.position, b.angle ?? 0)) : null;
    return box !== null && x >= box[0] - reach && x <= box[2] + reach && y >= box[1] - reach && y <= box[3] + reach;
  });
}

function keyboardInput(
  svg: SVGSVGElement,
  components: readonly Component[],
  action: readonly number[],
  active: () => string,
  activate: (name: string) => void,
  names: readonly string[],
  change: (values: [number, number][], target?: string) => void,
): void {
  const keys: Record<string, [Component["set"][], number]> = {
    ArrowLeft: [["x"], -1],
    ArrowRight: [["x"], 1],
    ArrowUp: [["y"], 1],
    ArrowDown: [["y"], -1],
    "]": [["radius", "angle"], 1],
    "[": [["radius", "angle"], -1],
  };
  svg.addEventListener("keydown", (event) => {
    // Shift with an arrow key moves the view.
    if (event.shiftKey || event.metaKey) return;
    if (event.key === "n" && names.length > 1) {
      activate(names[(names.indexOf(active()) + 1) % names.length]!);
      return;
    }
    const [sets, sign] = keys[event.key] ?? [[], 0];
    const i = components.findIndex((c) => c.target === active() && sets.includes(c.set));
    if (i < 0) return;
    event.preventDefault();
    change([[i, action[i]! + sign * (event.ctrlKey ? FINE_STEP_SHARE : STEP_SHARE)]]);
  });
}
