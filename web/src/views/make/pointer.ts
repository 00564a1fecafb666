// Pointer input in the picture: select, move, resize, rotate, draw, pan.

import { s } from "../../dom";
import type { Point, Scene } from "../../scene/types";
import { type Canvas, rectangleElement } from "./canvas";
import { dragHandle, hitTest, moveSelection } from "./handles";
import { drawPolygon, drawShape, type Tool, drawDefault } from "./tools";

/** State of the editor, and actions on it, for input handlers. */
export interface EditorActions {
  /** The displayed scene, in which every body has a position. */
  scene: () => Scene;
  /** The draft with the object's displayed position stored in it. */
  sceneWithDisplayedPose: (place: string) => Scene;
  selected: () => string;
  tool: () => Tool;
  /** Whether drawn objects are bodies. */
  moving: () => boolean;
  select: (place: string) => void;
  /** A step of a gesture; steps with the same key are undone together. */
  change: (scene: Scene, key: string) => void;
  /** The end of a drawing gesture: selects the result and the selection tool. */
  onDrawn: (done: { scene: Scene; place: string } | null) => void;
  onEnd: () => void;
}

/** Hit radius of handles for mouse and touch, and distance after which a press becomes a drag, px. */
const [MOUSE_RADIUS_PX, TOUCH_RADIUS_PX, DRAG_THRESHOLD_PX] = [9, 20, 3];

/** A polygon being drawn; Enter closes it, Escape discards it. */
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

/** Pans the view; without movement it is a click on empty space. */
function panning(at: Canvas, from: Point, click: () => void): Gesture {
  let panned = false;
  return {
    move: (p) => {
      panned = true;
      at.pan([from[0] - p[0], from[1] - p[1]]);
    },
    done: () => panned || click(),
  };
}

/** Draws a polygon vertex by vertex. */
function polygon(at: Canvas, actions: EditorActions): PolygonDrawing & { at: (p: Point) => null; toward: (p: Point) => void } {
  let corners: Point[] = [];
  const show = (to: Point | null): void => {
    const points = to ? [...corners, to] : corners;
    at.sketch(...(points.length ? [s("polyline", { points: points.map((p) => p.join(",")).join(" "), "vector-effect": "non-scaling-stroke" })] : []));
  };
  const close = (): void => {
    if (!corners.length) return;
    const done = drawPolygon(actions.sceneWithDisplayedPose(""), corners, actions.moving());
    // Fewer than three vertices: wait for more.
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
