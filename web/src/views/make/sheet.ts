// The form beside the picture, of what is selected: made anew when it asks for other fields, else filled again.

import { h, put } from "../../dom";
import { placeOf, scene, type State } from "./desk";
import { marked } from "./form";
import { type Desk, kind, panel, type Panel } from "./panels";
import { thing } from "./things";

export interface Sheet {
  element: HTMLElement;
  show: (state: State) => void;
  /** To the first of its fields, or the one that is wrong. */
  focus: () => void;
}

export function sheet(desk: Desk): Sheet {
  const title = h("h2", {});
  const place = h("div", {});
  const element = h("section", { class: "card form", "aria-label": "What is selected" }, title, place);
  let [made, current]: [string, Panel | null] = ["", null];
  const show = (state: State): void => {
    const now = kind(scene(state), state.selected);
    const one = thing(scene(state), state.selected);
    put(title, one ? one.name || "(no name)" : TITLES[state.selected]);
    if (now !== made || !current) {
      const held = holder(element);
      current = panel(desk, state.selected);
      put(place, current.element);
      made = now;
      for (const f of current.fields) f.show(scene(state));
      if (held) held(element);
    }
    for (const f of current.fields) f.show(scene(state));
    marked(current.fields, state.wrong && placeOf(state.wrong.field) === state.selected ? state.wrong : null);
  };
  const focus = (): void => {
    const wrong = element.querySelector<HTMLElement>('[aria-invalid="true"]');
    (wrong ?? element.querySelector<HTMLElement>("input, select, button"))?.focus();
  };
  return { element, show, focus };
}

const TITLES: Record<string, string> = { world: "World", goal: "Goal", action: "Action space", effects: "Effects" };

/** What gives the focus back to the field or button that has it now, or one of the same name. */
function holder(element: HTMLElement): ((element: HTMLElement) => void) | null {
  const held = document.activeElement;
  if (!(held instanceof HTMLElement) || !element.contains(held)) return null;
  const [path, name] = [held.dataset.field, held.getAttribute("aria-label") ?? held.textContent];
  return (now) => {
    const all = [...now.querySelectorAll<HTMLElement>("input, select, button")];
    const same = path ? all.find((e) => e.dataset.field === path) : all.find((e) => (e.getAttribute("aria-label") ?? e.textContent) === name);
    (same ?? all[0])?.focus();
  };
}
