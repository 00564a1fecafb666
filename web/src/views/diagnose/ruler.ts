// A ruler: dragging it along an object of known length gives the size of a pixel.

import { h, s, set } from "../../dom";
import { type Field, numeric } from "../../parts/field";
import type { Picture } from "../../scene/draw";
import type { Point } from "../../scene/types";

/** The last known length, m, and the measured length, px. */
const measured: { known: number | null; pixels: number | null } = { known: null, pixels: null };

/** A ruler over a picture drawn with `metresPerPixelDrawn`; `onScale` gets the size of a pixel, m. */
export function ruler(at: Picture, metresPerPixelDrawn: number, onScale: (metresPerPixel: number) => void): HTMLElement {
  const line = s("line", { class: "ruler", "vector-effect": "non-scaling-stroke", visibility: "hidden" });
  at.over.append(line);
  const report = (): void => {
    if (measured.known !== null && measured.known > 0 && measured.pixels) onScale(Number((measured.known / measured.pixels).toPrecision(5)));
    else if (measured.pixels) field.refuse("Enter its length.");
  };
  const field: Field = numeric("Or drag along an object of length", "m", measured.known, (v) => {
    measured.known = v;
    if (measured.pixels) report();
  });
  let from: Point | null = null;
  at.svg.classList.add("measured");
  at.svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    at.svg.setPointerCapture(event.pointerId);
    from = at.at(event);
    set(line, { x1: from[0], y1: from[1], x2: from[0], y2: from[1], visibility: "visible" });
  });
  at.svg.addEventListener("pointermove", (event) => {
    if (!from) return;
    const [x, y] = at.at(event);
    set(line, { x2: x, y2: y });
  });
  at.svg.addEventListener("pointerup", (event) => {
    if (!from) return;
    const to = at.at(event);
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    from = null;
    if (length === 0) return;
    measured.pixels = length / metresPerPixelDrawn;
    report();
  });
  return h("div", { class: "ruled" }, field.element);
}
