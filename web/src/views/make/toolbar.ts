// The toolbar: drawing tools, body or static, undo and redo, zoom.

import { uniqueId, h, put, set } from "../../dom";
import { type Tool, TOOLS } from "./tools";

export interface Toolbar {
  element: HTMLElement;
  hint: HTMLElement;
  /** Displays a message in place of the hint. */
  showMessage: (text: string) => void;
  show: (tool: Tool, moving: boolean, undo: boolean, redo: boolean) => void;
}

export interface ToolbarActions {
  tool: (tool: Tool) => void;
  moving: (moving: boolean) => void;
  undo: () => void;
  redo: () => void;
  zoom: (factor: number) => void;
  fit: () => void;
}

/** Tools that draw objects. */
const OBJECT_TOOLS: readonly Tool[] = ["disc", "box", "polygon", "segment"];

export function toolbar(actions: ToolbarActions): Toolbar {
  const tools = TOOLS.map(({ tool, title, key }) => {
    const button = actionButton(title, () => actions.tool(tool));
    return set(button, { "data-tool": tool, title: `${title} (${key})` });
  });
  const id = uniqueId("moving");
  const kind = h("select", { id }, h("option", { value: "moves" }, "body"), h("option", { value: "stands" }, "static"));
  kind.addEventListener("change", () => actions.moving(kind.value === "moves"));
  const of = h("span", { class: "row kind" }, h("label", { for: id }, "Draws:"), kind);
  const [undo, redo] = [actionButton("Undo", actions.undo), actionButton("Redo", actions.redo)];
  const zoom = [["−", "Zoom out", () => actions.zoom(1.25)], ["+", "Zoom in", () => actions.zoom(0.8)]] as const;
  const viewButtons = [...zoom.map(([sign, title, act]) => set(actionButton(sign, act), { "aria-label": title, title })), actionButton("Show all", actions.fit)];
  const group = (label: string, ...parts: HTMLElement[]): HTMLElement => h("div", { class: "row", role: "group", "aria-label": label }, ...parts);
  const hint = h("p", { class: "soft hint" });
  const element = h("div", { class: "row toolbar" }, group("Tools", ...tools), group("History", undo, redo), group("View", ...viewButtons));
  return {
    element,
    hint: h("div", { class: "row between" }, hint, of),
    showMessage: (text) => void put(hint, h("strong", {}, text)),
    show: (tool, moving, before, after) => {
      for (const one of tools) set(one, { "aria-pressed": String(one.dataset.tool === tool) });
      [undo.disabled, redo.disabled] = [!before, !after];
      of.hidden = !OBJECT_TOOLS.includes(tool);
      kind.value = moving ? "moves" : "stands";
      put(hint, TOOLS.find((t) => t.tool === tool)?.hint);
    },
  };
}

function actionButton(title: string, act: () => void): HTMLButtonElement {
  const button = h("button", { type: "button" }, title);
  button.addEventListener("click", act);
  return button;
}
