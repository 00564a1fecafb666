// Controls of a view: buttons, wheel and keys; and the scale bar.

import { h, put } from "../dom";
import type { Picture } from "./draw";
import type { Viewport } from "./viewport";

/** Factor of a button or key, and of a wheel's pixel. */
const [STEP_FACTOR, WHEEL_FACTOR] = [1.25, 1.0015];
/** Share of the view that a key moves it by. */
const KEY_SHARE = 0.1;
/** Maximum length of the scale bar, px. */
const MAX_BAR_PX = 120;

/** Buttons that zoom and fit. */
export function viewButtons(view: Viewport): HTMLElement {
  const button = (text: string, label: string, act: () => void): HTMLElement => {
    const element = h("button", { type: "button", "aria-label": label, title: label }, text);
    element.addEventListener("click", act);
    return element;
  };
  return h(
    "div",
    { class: "view-buttons", role: "group", "aria-label": "View" },
    button("+", "Zoom in", () => view.zoom(1 / STEP_FACTOR)),
    button("−", "Zoom out", () => view.zoom(STEP_FACTOR)),
    button("Fit", "Fit the view to the scene", view.fit),
  );
}

/** Zooms with the wheel, about the pointer. */
export function wheelInput(drawing: Picture, view: Viewport): void {
  drawing.svg.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      // Lines and pages in pixels.
      const pixels = event.deltaY * ([1, 16, 400][event.deltaMode] ?? 1);
      view.zoom(WHEEL_FACTOR ** Math.max(-400, Math.min(400, pixels)), drawing.at(event));
    },
    { passive: false },
  );
}

/** Plus, minus and 0 zoom and fit; Shift with an arrow key moves the view. */
export function viewKeys(svg: SVGSVGElement, view: Viewport): void {
  const keys: Record<string, () => void> = {
    "+": () => view.zoom(1 / STEP_FACTOR),
    "=": () => view.zoom(1 / STEP_FACTOR),
    "-": () => view.zoom(STEP_FACTOR),
    "0": view.fit,
  };
  const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  svg.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = event.shiftKey ? arrows[event.key] : undefined;
    const act = arrow ? () => view.panShare(KEY_SHARE * arrow[0], KEY_SHARE * arrow[1]) : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

/** A scale bar of a round length; `show` gets the size of a pixel, m. */
export function scaleBar(): { element: HTMLElement; show: (pixel: number) => void } {
  const [bar, text] = [h("span", { class: "bar" }), h("span")];
  const element = h("div", { class: "scale-bar" }, bar, text);
  return {
    element,
    show: (pixel) => {
      const length = roundBelow(MAX_BAR_PX * pixel);
      bar.style.width = `${(length / pixel).toFixed(1)}px`;
      put(text, `${Number(length.toPrecision(2))} m`);
    },
  };
}

/** The largest round number (1, 2, 5 times a power of ten) up to `limit`. */
export function roundBelow(limit: number): number {
  const ten = 10 ** Math.floor(Math.log10(limit) + 1e-9);
  return [5, 2, 1].map((m) => m * ten).find((v) => v <= limit * (1 + 1e-9)) ?? ten;
}
