// The film of one action in a world: placement, motion, outcome.

import { h, put, s } from "../../dom";
import { player } from "../../parts/player";
import { colours } from "../../scene/colour";
import { line, picture } from "../../scene/draw";
import { posesAt, filmLength, type Film, pathUntil } from "../../scene/film";
import { applyAction } from "../../scene/action";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";

export interface FilmPlayer {
  element: HTMLElement;
  /** Displays the current scene, and why nothing moves. */
  empty: (why: string) => void;
  /** Displays an action with its film; without a film the action was not executed. */
  show: (action: readonly number[], film: Film | null, verdict: string) => void;
}

/** The film player of a scene. */
export function filmPlayer(scene: Scene, label: string, context: Context): FilmPlayer {
  const drawing = picture(scene, label);
  const trails = s("g");
  drawing.over.append(trails);
  const bodyColours = colours(scene);
  let film: Film | null = null;
  const play = player((time) => {
    if (film) drawing.pose("solid", posesAt(film, time));
  }, context.signal);
  const badge = h("p", { class: "row", role: "status" });
  const paths = (of: Film): SVGElement[] => Object.keys(of.bodies).map((name) => line(pathUntil(of, name, filmLength(of)), { class: "trail", stroke: bodyColours.get(name) ?? "currentColor" }));
  const load = (now: Film | null, length: number): void => {
    film = now;
    put(trails, ...(now ? paths(now) : []));
    play.load(length);
    drawing.svg.dataset.film = String(Number(drawing.svg.dataset.film ?? 0) + 1);
  };
  return {
    element: h("div", { class: "stage" }, drawing.svg, play.element, badge),
    empty: (why) => {
      load(null, 0);
      drawing.redraw(scene);
      put(badge, h("span", { class: "soft" }, why));
    },
    show: (action, now, verdict) => {
      drawing.redraw(applyAction(scene, action));
      load(now, now ? filmLength(now) : 0);
      put(badge, verdict ? h("span", { class: "badge", "data-verdict": verdict }, verdict) : null);
      if (now) play.restart();
    },
  };
}
