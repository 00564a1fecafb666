// The canvas of the simulation compared with, beside the main canvas on wide screens.

import { h, put } from "../../dom";
import { picture } from "../../scene/draw";
import type { Box, Pose, Scene } from "../../scene/types";
import { wheelInput } from "../../scene/viewControls";
import type { Viewport } from "../../scene/viewport";
import { pointerInput } from "./pointer";

export interface ComparisonCanvas {
  element: HTMLElement;
  svg: SVGSVGElement;
  /** Caption of the main canvas, displayed while there are two. */
  caption: HTMLElement;
  /** Shows the canvas with a title; `null` hides it. */
  show: (title: string | null) => void;
  frame: (box: Box) => void;
  redraw: (scene: Scene) => void;
  pose: (poses: ReadonlyMap<string, Pose>) => void;
}

/** A second canvas with the view of the first. */
export function comparisonCanvas(scene: Scene, view: Viewport): ComparisonCanvas {
  const drawing = picture(scene, "The simulation compared with");
  const title = h("span", { class: "canvas-title" });
  const caption = h("span", { class: "canvas-title", hidden: true }, "As set");
  const element = h("div", { class: "stage canvas second", hidden: true }, drawing.svg, title);
  wheelInput(drawing, view);
  pointerInput(drawing, view, null);
  return {
    element,
    svg: drawing.svg,
    caption,
    show: (text) => {
      element.hidden = caption.hidden = text === null;
      put(title, text);
    },
    frame: drawing.frame,
    redraw: drawing.redraw,
    pose: (poses) => drawing.pose("solid", poses),
  };
}
