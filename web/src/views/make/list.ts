// The list of what a scene has: the world, goal, action, bodies, statics. One of them is selected.

import { h, put } from "../../dom";
import { colours } from "../../scene/colour";
import type { Scene } from "../../scene/types";
import { moves, places, thing } from "./things";

export interface List {
  element: HTMLElement;
  show: (scene: Scene, selected: string, bad: string | null) => void;
}

export function list(select: (place: string) => void): List {
  const element = h("div", { class: "things", role: "group", "aria-label": "What the scene has" });
  const button = (scene: Scene, place: string, selected: string, bad: string | null): HTMLElement => {
    const one = thing(scene, place);
    const colour = one && moves(place) ? colours(scene).get(one.name) : null;
    const mark = one ? h("span", { class: moves(place) ? "dot" : "dot fixed", "aria-hidden": "true" }) : null;
    if (mark && colour) mark.style.background = colour;
    const words = [one ? one.name || "(no name)" : FIXED[place], bad === place ? h("span", { class: "wrong" }, " !", h("span", { class: "unseen" }, " has an error")) : null];
    const made = h("button", { type: "button", "data-place": place, "aria-pressed": String(place === selected) }, mark, ...words);
    made.addEventListener("click", () => select(place));
    return made;
  };
  return {
    element,
    show: (scene, selected, bad) => {
      // What has the focus keeps it.
      const held = element.contains(document.activeElement) ? (document.activeElement as HTMLElement).dataset.place : null;
      put(element, ...[...Object.keys(FIXED), ...places(scene)].map((place) => button(scene, place, selected, bad)));
      if (held) (element.querySelector<HTMLElement>(`[data-place="${held}"]`) ?? element.querySelector("button"))?.focus();
    },
  };
}

const FIXED: Record<string, string> = { world: "World", goal: "Goal", action: "Action space", effects: "Effects" };
