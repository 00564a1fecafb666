// The row over the picture: tools, whether what they draw moves, undo and redo, how much is seen.

import { uniqueId, h, put, set } from "../../dom";
import { type Tool, TOOLS } from "./tools";

export interface Toolbar {
  element: HTMLElement;
  hint: HTMLElement;
  /** Says something in place of the hint. */
  tell: (text: string) => void;
  show: (tool: Tool, moving: boolean, undo: boolean, redo: boolean) => void;
}

export interface Presses {
  tool: (tool: Tool) => void;
  moving: (moving: boolean) => void;
  undo: () => void;
  redo: () => void;
  zoom: (factor: number) => void;
  fit: () => void;
}

/** Tools that draw things. */
const THINGS: readonly Tool[] = ["disc", "box", "polygon", "segment"];

export function toolbar(presses: Presses): Toolbar {
  const tools = TOOLS.map(({ tool, title, key }) => {
    const made = pressed(title, () => presses.tool(tool));
    return set(made, { "data-tool": tool, title: `${title} (${key})` });
  });
  const id = uniqueId("moving");
  const kind = h("select", { id }, h("option", { value: "moves" }, "it moves"), h("option", { value: "stands" }, "it never moves"));
  kind.addEventListener("change", () => presses.moving(kind.value === "moves"));
  const of = h("span", { class: "row kind" }, h("label", { for: id }, "Draws:"), kind);
  const [undo, redo] = [pressed("Undo", presses.undo), pressed("Redo", presses.redo)];
  const zoom = [["−", "Farther", () => presses.zoom(1.25)], ["+", "Nearer", () => presses.zoom(0.8)]] as const;
  const seen = [...zoom.map(([sign, title, act]) => set(pressed(sign, act), { "aria-label": title, title })), pressed("Show all", presses.fit)];
  const group = (label: string, ...parts: HTMLElement[]): HTMLElement => h("div", { class: "row", role: "group", "aria-label": label }, ...parts);
  const hint = h("p", { class: "soft hint" });
  const element = h("div", { class: "row toolbar" }, group("Tools", ...tools), group("History", undo, redo), group("View", ...seen));
  return {
    element,
    hint: h("div", { class: "row between" }, hint, of),
    tell: (text) => void put(hint, h("strong", {}, text)),
    show: (tool, moving, before, after) => {
      for (const one of tools) set(one, { "aria-pressed": String(one.dataset.tool === tool) });
      [undo.disabled, redo.disabled] = [!before, !after];
      of.hidden = !THINGS.includes(tool);
      kind.value = moving ? "moves" : "stands";
      put(hint, TOOLS.find((t) => t.tool === tool)?.hint);
    },
  };
}

function pressed(title: string, act: () => void): HTMLButtonElement {
  const made = h("button", { type: "button" }, title);
  made.addEventListener("click", act);
  return made;
}
