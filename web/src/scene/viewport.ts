// The visible part of a picture: zoom, pan, fit. The view has the aspect ratio of its element.

import type { Picture } from "./draw";
import { withAspect } from "./extent";
import type { Box, Point } from "./types";

export interface Viewport {
  /** The visible box, m. */
  box: () => Box;
  /** Size of a pixel, m. */
  pixel: () => number;
  /** Zooms about a point, by default the centre; a factor below 1 enlarges. */
  zoom: (factor: number, about?: Point) => void;
  /** Moves the view, m. */
  pan: (by: Point) => void;
  /** Moves the view by a share of its size. */
  panShare: (x: number, y: number) => void;
  /** Shows the fitted box. */
  fit: () => void;
  /** Sets the fitted box; with `show`, also shows it unless the view was moved. */
  fitTo: (box: Box, show: boolean) => void;
}

/** Range of the view's width relative to the fitted box. */
const [MIN_SHARE, MAX_SHARE] = [1e-3, 1e3];

/** Makes the view of a picture movable; `onChange` is called after every change. */
export function viewport(drawing: Picture, first: Box, onChange: () => void, signal: AbortSignal): Viewport {
  const { svg } = drawing;
  let [fitted, requested, view, aspect, moved] = [first, first, first, 0, false];
  const look = (box: Box): void => {
    requested = box;
    view = aspect ? withAspect(box, aspect) : box;
    drawing.frame(view);
    onChange();
  };
  const move = (box: Box): void => {
    moved = true;
    look(box);
  };
  const zoom = (factor: number, about?: Point): void => {
    const share = ((view[2] - view[0]) * factor) / (fitted[2] - fitted[0]);
    if (!(share > MIN_SHARE && share < MAX_SHARE)) return;
    const [x, y] = about ?? [(view[0] + view[2]) / 2, (view[1] + view[3]) / 2];
    move([x + (view[0] - x) * factor, y + (view[1] - y) * factor, x + (view[2] - x) * factor, y + (view[3] - y) * factor]);
  };
  const pan = ([x, y]: Point): void => move([view[0] + x, view[1] + y, view[2] + x, view[3] + y]);
  const resized = new ResizeObserver(() => {
    if (!svg.clientWidth || !svg.clientHeight) return;
    aspect = svg.clientWidth / svg.clientHeight;
    look(requested);
  });
  resized.observe(svg);
  signal.addEventListener("abort", () => resized.disconnect());
  return {
    box: () => view,
    pixel: () => (view[2] - view[0]) / Math.max(1, svg.clientWidth),
    zoom,
    pan,
    panShare: (x, y) => pan([x * (view[2] - view[0]), y * (view[3] - view[1])]),
    fit: () => {
      moved = false;
      look(fitted);
    },
    fitTo: (box, show) => {
      fitted = box;
      if (show && !moved) look(box);
    },
  };
}
