// The canvases of a scene: the main one, the one compared with beside it, and the view they share.

import { h, put, s, set } from "../../dom";
import { picture, type Picture } from "../../scene/draw";
import { bodyThickness, pathCorners, sceneExtent } from "../../scene/extent";
import type { Film } from "../../scene/film";
import type { Box, Point, Scene } from "../../scene/types";
import { scaleBar, viewButtons, viewKeys, wheelInput } from "../../scene/viewControls";
import { viewport, type Viewport } from "../../scene/viewport";
import { comparisonCanvas, type ComparisonCanvas } from "./comparisonCanvas";
import { keysHelp } from "./keys";
import { pointerInput } from "./pointer";

/** Range of the aspect ratio of a canvas. */
const [MIN_ASPECT, MAX_ASPECT] = [0.8, 2];

export interface SceneView {
  element: HTMLElement;
  picture: Picture;
  view: Viewport;
  second: ComparisonCanvas;
  /** Fits the view to films, too; with `follow` shows it. Only in scenes without bounds or a view of their own. */
  fitTo: (films: readonly (Film | null)[], follow: boolean) => void;
}

/** The canvases of a scene; `box` is the fitted view, `onView` is called when the view changes. Unless `placeable`, the pointer moves
 * the view. */
export function sceneView(scene: Scene, label: string, box: Box | undefined, placeable: boolean, onView: () => void, signal: AbortSignal): SceneView {
  const fitted = box ?? sceneExtent(scene, actionCorners(scene));
  const drawing = picture(scene, label, fitted);
  const bar = scaleBar();
  const view = viewport(drawing, fitted, () => {
    bar.show(view.pixel());
    second.frame(view.box());
    onView();
  }, signal);
  const second = comparisonCanvas(scene, view);
  const shape = ([left, bottom, right, top]: Box): void => {
    const aspect = Math.min(MAX_ASPECT, Math.max(MIN_ASPECT, (right - left) / (top - bottom)));
    for (const svg of [drawing.svg, second.svg]) svg.style.aspectRatio = String(aspect);
  };
  shape(fitted);
  set(drawing.svg, { tabindex: 0, role: "application" });
  put(drawing.svg, s("title", {}, label), ...drawing.svg.childNodes);
  wheelInput(drawing, view);
  viewKeys(drawing.svg, view);
  if (!placeable) pointerInput(drawing, view, null);
  const tools = h("div", { class: "canvas-tools" }, viewButtons(view), keysHelp(placeable && Boolean(scene.action?.components.length)));
  return {
    element: h("div", { class: "canvases" }, h("div", { class: "stage canvas" }, drawing.svg, tools, bar.element, second.caption), second.element),
    picture: drawing,
    view,
    second,
    fitTo: (films, follow) => {
      if (box || scene.action?.bounds) return;
      const now = filmExtent(scene, films, fitted);
      if (follow) shape(now);
      view.fitTo(now, follow);
    },
  };
}

/** Corners of the area in which an action places objects. */
function actionCorners(scene: Scene): Point[] {
  const components = scene.action?.components ?? [];
  return components.flatMap((x): Point[] => {
    const y = x.set === "x" ? components.find((c) => c.target === x.target && c.set === "y") : undefined;
    return y ? [[x.low, y.low], [x.high, y.high]] : [];
  });
}

/** The extent of a scene with the films of its bodies. */
function filmExtent(scene: Scene, films: readonly (Film | null)[], near: Box): Box {
  const corners = films.flatMap((film) =>
    scene.bodies.flatMap((body) => {
      const track = film?.bodies[body.name];
      return track ? pathCorners(track.x.map((x, k): Point => [x, track.y[k]!]), bodyThickness(body) / 2, near) : [];
    }),
  );
  return sceneExtent(scene, [...actionCorners(scene), ...corners]);
}
