// The list of the scene's parts: world, goal, action, bodies, statics. One of them is selected.

import { h, put } from "../../dom";
import { colours } from "../../scene/colour";
import type { Scene } from "../../scene/types";
import { isBody, objectPaths, objectAt } from "./objects";

export interface ObjectList {
  element: HTMLElement;
  show: (scene: Scene, selected: string, invalid: string | null) => void;
}

export function objectList(select: (place: string) => void): ObjectList {
  const element = h("div", { class: "things", role: "group", "aria-label": "Parts of the scene" });
  const button = (scene: Scene, place: string, selected: string, invalid: string | null): HTMLElement => {
    const object = objectAt(scene, place);
    const colour = object && isBody(place) ? colours(scene).get(object.name) : null;
    const mark = object ? h("span", { class: isBody(place) ? "dot" : "dot fixed", "aria-hidden": "true" }) : null;
    if (mark && colour) mark.style.background = colour;
    const label = [object ? object.name || "(no name)" : SECTION_TITLES[place], invalid === place ? h("span", { class: "wrong" }, " !", h("span", { class: "unseen" }, " has an error")) : null];
    const element = h("button", { type: "button", "data-place": place, "aria-pressed": String(place === selected) }, mark, ...label);
    element.addEventListener("click", () => select(place));
    return element;
  };
  return {
    element,
    show: (scene, selected, invalid) => {
      // Keep the focus.
      const focused = element.contains(document.activeElement) ? (document.activeElement as HTMLElement).dataset.place : null;
      put(element, ...[...Object.keys(SECTION_TITLES), ...objectPaths(scene)].map((place) => button(scene, place, selected, invalid)));
      if (focused) (element.querySelector<HTMLElement>(`[data-place="${focused}"]`) ?? element.querySelector("button"))?.focus();
    },
  };
}

const SECTION_TITLES: Record<string, string> = { world: "World", goal: "Goal", action: "Action space", effects: "Effects" };
