// A slider with label and value.

import { uniqueId, h, put, set } from "../dom";

export interface Slider {
  element: HTMLElement;
  /** Moves it without calling `onMove`. */
  show: (share: number) => void;
}

/** A slider from 0 to 1; `text` formats a position, `onMove` is called while dragging. */
export function slider(label: string, share: number, text: (share: number) => string, onMove: (share: number) => void): Slider {
  const id = uniqueId("slider");
  const input = h("input", { id, type: "range", min: 0, max: 1, step: 0.001 });
  const output = h("output", { for: id });
  const show = (now: number): void => {
    input.value = String(now);
    const valueText = text(now);
    put(output, valueText);
    set(input, { "aria-valuetext": valueText });
  };
  input.addEventListener("input", () => {
    const now = Number(input.value);
    show(now);
    onMove(now);
  });
  show(share);
  return { element: h("div", { class: "slider" }, h("label", { for: id }, label), output, input), show };
}

/** A number with about three significant digits. */
export function short(value: number, unit = ""): string {
  const size = Math.abs(value);
  const digits = size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3;
  return `${value.toFixed(size === 0 ? 0 : digits)}${unit ? ` ${unit}` : ""}`;
}
