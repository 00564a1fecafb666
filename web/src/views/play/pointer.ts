// Mouse and touch on the scene: place an object, move the view, pinch to zoom.

import type { Picture } from "../../scene/draw";
import type { Point } from "../../scene/types";
import type { Viewport } from "../../scene/viewport";

/** Distance below which a press is a click, and reach around an object, px. */
const [CLICK_PX, REACH_PX] = [5, 12];

export interface PlacementTarget {
  /** Whether a placeable object is within `reach` of a point, m. */
  hits: (p: Point, reach: number) => boolean;
  /** Places the nearest object; `begin` at the start of a gesture. */
  place: (p: Point, begin: boolean) => void;
}

type Mode = "idle" | "place" | "ground" | "pan" | "pinch";

/** A press on an object drags it, a click on the ground places there, a drag of the ground moves the view, two fingers zoom. */
export function pointerInput(drawing: Picture, view: Viewport, target: PlacementTarget | null): void {
  const { svg } = drawing;
  const fingers = new Map<number, Point>();
  let mode: Mode = "idle";
  const become = (now: Mode): void => {
    mode = now;
    svg.dataset.gesture = now;
  };
  const move = (from: Point, to: Point): void => view.pan([-(to[0] - from[0]) * view.pixel(), (to[1] - from[1]) * view.pixel()]);
  const pinch = (id: number, to: Point): void => {
    const [from, still] = [fingers.get(id)!, [...fingers].find(([other]) => other !== id)?.[1]];
    if (!still) return;
    const middle = (p: Point): Point => [(p[0] + still[0]) / 2, (p[1] + still[1]) / 2];
    const span = (p: Point): number => Math.max(1, Math.hypot(p[0] - still[0], p[1] - still[1]));
    move(middle(from), middle(to));
    const [clientX, clientY] = middle(to);
    view.zoom(span(from) / span(to), drawing.at({ clientX, clientY }));
  };
  svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || fingers.size >= 2) return;
    svg.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const p = drawing.at(event);
    if (fingers.size === 2) return become("pinch");
    if (!target?.hits(p, REACH_PX * view.pixel())) return become("ground");
    become("place");
    target.place(p, true);
  });
  svg.addEventListener("pointermove", (event) => {
    const from = fingers.get(event.pointerId);
    if (!from) return;
    const to: Point = [event.clientX, event.clientY];
    if (mode === "ground" && Math.hypot(to[0] - from[0], to[1] - from[1]) < CLICK_PX) return;
    if (mode === "place") target?.place(drawing.at(event), false);
    else if (mode === "pinch") pinch(event.pointerId, to);
    else {
      become("pan");
      move(from, to);
    }
    fingers.set(event.pointerId, to);
  });
  const end = (event: PointerEvent): void => {
    if (!fingers.delete(event.pointerId)) return;
    if (mode === "ground" && event.type === "pointerup") target?.place(drawing.at(event), true);
    become(fingers.size ? "pan" : "idle");
  };
  svg.addEventListener("pointerup", end);
  svg.addEventListener("pointercancel", end);
}
