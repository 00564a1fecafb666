// The canvas of the simulation compared with, beside the main canvas on wide screens.

import { h, put } from "../../dom";
import { picture } from "../../scene/draw";
import { posesAt, type Film } from "../../scene/film";
import type { Box, Scene } from "../../scene/types";
import { wheelInput } from "../../scene/viewControls";
import type { Viewport } from "../../scene/viewport";
import { pointerInput } from "./pointer";
import { trails } from "./trails";

export interface ComparisonCanvas {
  element: HTMLElement;
  svg: SVGSVGElement;
  /** Caption of the main canvas, displayed while there are two. */
  caption: HTMLElement;
  /** Shows the canvas with a title and the trajectories of a film; `null` hides it. */
  show: (title: string | null, film: Film | null) => void;
  frame: (box: Box) => void;
  redraw: (scene: Scene) => void;
  /** Moves the bodies to a time of the film, s. */
  pose: (time: number) => void;
}

/** A second canvas with the view of the first. */
export function comparisonCanvas(scene: Scene, view: Viewport): ComparisonCanvas {
  const drawing = picture(scene, "The simulation compared with");
  const title = h("span", { class: "canvas-title" });
  const caption = h("span", { class: "canvas-title", hidden: true }, "As set");
  const element = h("div", { class: "canvas second", hidden: true }, drawing.svg, title);
  let [currentScene, currentFilm]: [Scene, Film | null] = [scene, null];
  wheelInput(drawing, view);
  pointerInput(drawing, view, null);
  return {
    element,
    svg: drawing.svg,
    caption,
    show: (text, film) => {
      currentFilm = film;
      if (element.hidden && text !== null) drawing.redraw(currentScene);
      element.hidden = caption.hidden = text === null;
      put(drawing.over, ...(film ? trails(film, "trail other", () => "currentColor") : []));
      put(title, text);
    },
    frame: drawing.frame,
    redraw: (now) => {
      currentScene = now;
      if (!element.hidden) drawing.redraw(now);
    },
    pose: (time) => {
      if (currentFilm) drawing.pose("solid", posesAt(currentFilm, time));
    },
  };
}
