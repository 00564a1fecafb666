// The keys of the scene, in a popover.

import { h, uniqueId } from "../../dom";

const KEYS: readonly (readonly [string, string])[] = [
  ["Arrow keys", "move the object to place"],
  ["Ctrl and arrow keys", "move it in fine steps"],
  ["[ and ]", "change its size or angle"],
  ["N", "select the next object"],
  ["+ and −", "zoom in and out"],
  ["Shift and arrow keys", "move the view"],
  ["0", "fit the view to the scene"],
];
const POINTER: readonly (readonly [string, string])[] = [
  ["Click", "place the object there"],
  ["Drag the object", "move it"],
  ["Drag the ground", "move the view"],
  ["Wheel, or two fingers", "zoom"],
];

/** A button that opens the list of keys. */
export function keysHelp(): HTMLElement {
  const id = uniqueId("keys");
  const list = (rows: readonly (readonly [string, string])[]): HTMLElement => h("dl", { class: "keys-list" }, ...rows.flatMap(([key, effect]) => [h("dt", {}, key), h("dd", {}, effect)]));
  const close = h("button", { type: "button", popovertarget: id, popovertargetaction: "hide" }, "Close");
  const popover = h(
    "div",
    { id, popover: "auto", class: "keys", role: "dialog", "aria-label": "Keys and pointer" },
    h("div", { class: "row between" }, h("h2", {}, "Keys"), close),
    h("p", { class: "help" }, "They work while the scene has the focus."),
    list(KEYS),
    h("h3", {}, "Mouse and touch"),
    list(POINTER),
  );
  return h("span", {}, h("button", { type: "button", popovertarget: id, title: "Keys of the scene" }, "Keys"), popover);
}
