// The properties panel of the selection; rebuilt if it needs other fields, else updated.

import { h, put } from "../../dom";
import { locationOf, currentScene, type EditorState } from "./editorState";
import { markFields } from "./formFields";
import type { FormContext, Panel } from "./panel";
import { formKey, panel } from "./panels";
import { objectAt } from "./objects";

export interface PropertiesPanel {
  element: HTMLElement;
  show: (state: EditorState) => void;
  /** Focuses the first field, or the one with an error. */
  focus: () => void;
}

export function propertiesPanel(desk: FormContext): PropertiesPanel {
  const title = h("h2", {});
  const place = h("div", {});
  const element = h("section", { class: "card form", "aria-label": "Properties" }, title, place);
  let [currentKind, current]: [string, Panel | null] = ["", null];
  const show = (state: EditorState): void => {
    const now = formKey(currentScene(state), state.selected);
    const object = objectAt(currentScene(state), state.selected);
    put(title, object ? object.name || "(no name)" : TITLES[state.selected]);
    if (now !== currentKind || !current) {
      const focused = focusRestorer(element);
      current = panel(desk, state.selected);
      put(place, current.element);
      currentKind = now;
      for (const f of current.fields) f.show(currentScene(state));
      if (focused) focused(element);
    }
    for (const f of current.fields) f.show(currentScene(state));
    markFields(current.fields, state.problem && locationOf(state.problem.field) === state.selected ? state.problem : null);
  };
  const focus = (): void => {
    const invalid = element.querySelector<HTMLElement>('[aria-invalid="true"]');
    (invalid ?? element.querySelector<HTMLElement>("input, select, button"))?.focus();
  };
  return { element, show, focus };
}

const TITLES: Record<string, string> = { world: "World", goal: "Goal", action: "Action space", effects: "Effects" };

/** A function that restores the focus to the same field or button after a rebuild. */
function focusRestorer(element: HTMLElement): ((element: HTMLElement) => void) | null {
  const focused = document.activeElement;
  if (!(focused instanceof HTMLElement) || !element.contains(focused)) return null;
  const [path, name] = [focused.dataset.field, focused.getAttribute("aria-label") ?? focused.textContent];
  return (now) => {
    const all = [...now.querySelectorAll<HTMLElement>("input, select, button")];
    const same = path ? all.find((e) => e.dataset.field === path) : all.find((e) => (e.getAttribute("aria-label") ?? e.textContent) === name);
    (same ?? all[0])?.focus();
  };
}
