// The mouse in the picture: selects, moves, resizes, turns, draws, and moves what is seen.

import { s } from "../../dom";
import type { Point, Scene } from "../../scene/types";
import { type Canvas, rectangleElement } from "./canvas";
import { dragHandle, hitTest, moveSelection } from "./handles";
import { drawPolygon, drawShape, type Tool, drawDefault } from "./tools";

/** What a gesture sees of the draft, and does to it. */
export interface EditorActions {
  /** The scene as it is drawn, every body somewhere. */
  scene: () => Scene;
  /** The draft with what is at a place standing where it is drawn. */
  sceneWithDisplayedPose: (place: string) => Scene;
  selected: () => string;
  tool: () => Tool;
  /** Whether what is drawn moves. */
  moving: () => boolean;
  select: (place: string) => void;
  /** A step of a gesture; those with the same key are undone together. */
  change: (scene: Scene, key: string) => void;
  /** A gesture is over: what it drew is selected, and things are selected again. */
  onDrawn: (done: { scene: Scene; place: string } | null) => void;
  onEnd: () => void;
}

/** How near the mouse has to be, or a finger to a handle, and how far it has to go before something is dragged, pixels. */
const [MOUSE_RADIUS_PX, TOUCH_RADIUS_PX, DRAG_THRESHOLD_PX] = [9, 20, 3];

/** Corners of a polygon that is being drawn; Enter closes it, Escape gives it up. */
export interface PolygonDrawing {
  count: () => number;
  close: () => void;
  drop: () => void;
}

export function pointerInput(at: Canvas, actions: EditorActions, signal: AbortSignal): PolygonDrawing {
  let active: { move: (p: Point, event: PointerEvent) => void; done: (p: Point) => void; from: [number, number]; started: boolean } | null = null;
  let number = 0;
  const corners = polygon(at, actions);
  const svg = at.svg;
  const start = (event: PointerEvent): void => {
    if (event.button !== 0 || active) return;
    svg.setPointerCapture(event.pointerId);
    svg.focus({ preventScroll: true });
    number += 1;
    const p = at.picture.at(event);
    const gesture = actions.tool() === "select" ? editing(event, p, `drag-${number}`) : actions.tool() === "polygon" ? corners.at(p) : drawing(p);
    if (gesture) active = { ...gesture, from: [event.clientX, event.clientY], started: false };
  };
  const editing = (event: PointerEvent, from: Point, key: string): Gesture => {
    const handle = at.handle(from, event.pointerType === "touch" ? TOUCH_RADIUS_PX : MOUSE_RADIUS_PX);
    const place = handle === null ? hitTest(actions.scene(), from, MOUSE_RADIUS_PX * at.pixel()) : actions.selected();
    if (place === null) return panning(at, from, () => actions.select("world"));
    if (handle === null) actions.select(place);
    const before = actions.sceneWithDisplayedPose(place);
    const corner = at.snap(from);
    return {
      move: (p) => {
        const to = at.snap(p);
        const next = handle !== null ? dragHandle(before, place, handle, handle === "turn" ? p : to) : moveSelection(before, place, [to[0] - corner[0], to[1] - corner[1]]);
        actions.change(next, key);
      },
      done: () => actions.onEnd(),
    };
  };
  const drawing = (from: Point): Gesture => {
    const [tool, corner] = [actions.tool(), at.snap(from)];
    let to: Point | null = null;
    return {
      move: (p) => {
        to = at.snap(p);
        at.sketch(...preview(tool, corner, to));
      },
      done: () => {
        at.sketch();
        const [scene, moving, view, selected] = [actions.sceneWithDisplayedPose(""), actions.moving(), at.picture.box, actions.selected()] as const;
        actions.onDrawn(to ? drawShape(scene, tool, corner, to, moving, view, selected) : drawDefault(scene, tool, corner, moving, view, selected, at.step()));
      },
    };
  };
  svg.addEventListener("pointerdown", start, { signal });
  svg.addEventListener("pointermove", (event) => {
    const p = at.picture.at(event);
    if (!active) return corners.toward(at.snap(p));
    active.started ||= Math.hypot(event.clientX - active.from[0], event.clientY - active.from[1]) >= DRAG_THRESHOLD_PX;
    if (active.started) active.move(p, event);
  }, { signal });
  const stop = (event: PointerEvent): void => {
    active?.done(at.picture.at(event));
    active = null;
  };
  svg.addEventListener("pointerup", stop, { signal });
  svg.addEventListener("pointercancel", stop, { signal });
  svg.addEventListener("dblclick", () => corners.close(), { signal });
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    at.zoom(event.deltaY > 0 ? 1.15 : 1 / 1.15);
  }, { signal, passive: false });
  return corners;
}

interface Gesture {
  move: (p: Point, event: PointerEvent) => void;
  done: (p: Point) => void;
}

/** Moves what is seen; without a movement it is a click on nothing. */
function panning(at: Canvas, from: Point, click: () => void): Gesture {
  let moved = false;
  return {
    move: (p) => {
      moved = true;
      at.pan([from[0] - p[0], from[1] - p[1]]);
    },
    done: () => moved || click(),
  };
}

/** A polygon, corner by corner. */
function polygon(at: Canvas, actions: EditorActions): PolygonDrawing & { at: (p: Point) => null; toward: (p: Point) => void } {
  let corners: Point[] = [];
  const show = (to: Point | null): void => {
    const points = to ? [...corners, to] : corners;
    at.sketch(...(points.length ? [s("polyline", { points: points.map((p) => p.join(",")).join(" "), "vector-effect": "non-scaling-stroke" })] : []));
  };
  const close = (): void => {
    if (!corners.length) return;
    const done = drawPolygon(actions.sceneWithDisplayedPose(""), corners, actions.moving());
    // Two corners are none: more are waited for.
    if (!done) return;
    corners = [];
    at.sketch();
    actions.onDrawn(done);
  };
  return {
    at: (p) => {
      const [first, corner] = [corners[0], at.snap(p)];
      if (first && corners.length > 2 && Math.hypot(first[0] - p[0], first[1] - p[1]) < MOUSE_RADIUS_PX * at.pixel()) close();
      else corners.push(corner);
      show(null);
      return null;
    },
    toward: (p) => corners.length && show(p),
    count: () => corners.length,
    close,
    drop: () => {
      corners = [];
      at.sketch();
    },
  };
}

function preview(tool: Tool, from: Point, to: Point): SVGElement[] {
  const look = { "vector-effect": "non-scaling-stroke" };
  if (tool === "disc") return [s("circle", { cx: from[0], cy: from[1], r: Math.hypot(to[0] - from[0], to[1] - from[1]), ...look })];
  if (tool === "segment") return [s("line", { x1: from[0], y1: from[1], x2: to[0], y2: to[1], ...look })];
  return [rectangleElement([Math.min(from[0], to[0]), Math.min(from[1], to[1]), Math.max(from[0], to[0]), Math.max(from[1], to[1])], tool)];
}
