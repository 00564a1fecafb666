// The keys of the scene, in a popover.

import { h, uniqueId } from "../../dom";

type Rows = readonly (readonly [string, string])[];

const PLACEMENT_KEYS: Rows = [
  ["Arrow keys", "move the object to place"],
  ["Ctrl and arrow keys", "move it in fine steps"],
  ["[ and ]", "change its size or angle"],
  ["N", "select the next object"],
];
const VIEW_KEYS: Rows = [
  ["+ and −", "zoom in and out"],
  ["Shift and arrow keys", "move the view"],
  ["0", "fit the view to the scene"],
];
const PLACEMENT_POINTER: Rows = [
  ["Click", "place the object there"],
  ["Drag the object", "move it"],
];
const VIEW_POINTER: Rows = [
  ["Drag the ground", "move the view"],
  ["Wheel, or two fingers", "zoom"],
];

/** A button that opens the list of keys; those of placement only where objects are placed. */
export function keysHelp(placeable: boolean): HTMLElement {
  const id = uniqueId("keys");
  const list = (rows: Rows): HTMLElement => h("dl", { class: "keys-list" }, ...rows.flatMap(([key, effect]) => [h("dt", {}, key), h("dd", {}, effect)]));
  const close = h("button", { type: "button", popovertarget: id, popovertargetaction: "hide" }, "Close");
  const popover = h(
    "div",
    { id, popover: "auto", class: "keys", role: "dialog", "aria-label": "Keys and pointer" },
    h("div", { class: "row between" }, h("h2", {}, "Keys"), close),
    h("p", { class: "help" }, "They work while the scene has the focus."),
    list([...(placeable ? PLACEMENT_KEYS : []), ...VIEW_KEYS]),
    h("h3", {}, "Mouse and touch"),
    list([...(placeable ? PLACEMENT_POINTER : []), ...VIEW_POINTER]),
  );
  return h("span", {}, h("button", { type: "button", popovertarget: id, title: "Keys of the scene" }, "Keys"), popover);
}
