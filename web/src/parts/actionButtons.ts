// Buttons of a result, in groups.

import { h, put } from "../dom";
import "./actionButtons.css";

/** Groups in a row, those that are absent left out. */
export function actionGroups(...groups: (HTMLElement | null)[]): HTMLElement {
  return h("div", { class: "action-groups" }, ...groups);
}

/** Buttons under a heading. */
export function actionGroup(name: string, buttons: readonly HTMLElement[]): HTMLElement {
  return h("div", { class: "action-group", role: "group", "aria-label": name }, h("h3", {}, name), h("div", { class: "row" }, ...buttons));
}

/** A button; `label` is its full name, `title` a sentence of help. */
export function actionButton(text: string, label: string, title: string, act: () => void, main = false): HTMLButtonElement {
  const element = h("button", { type: "button", class: main ? "main" : null, "aria-label": label === text ? null : label, title });
  put(element, text);
  element.addEventListener("click", act);
  return element;
}
