// The layers of films on a picture: bodies, trajectories, measured positions, contact rings, arrows.

import { put, s } from "../../dom";
import { colours } from "../../scene/colour";
import type { Picture } from "../../scene/draw";
import { posesAt, type Film } from "../../scene/film";
import type { Pose, Scene } from "../../scene/types";
import { arrows, type ArrowScale } from "./arrows";
import type { Overlays } from "./overlays";
import { contactRings, dots, trails } from "./trails";

/** Time for which a contact is highlighted, s. */
const CONTACT_HIGHLIGHT_S = 0.2;

/** The films of an action. */
export interface Films {
  simulated: Film | null;
  real: Film | null;
  compared: Film | null;
}

export interface FilmLayers {
  /** Draws films; returns the scales of their arrows. */
  load: (films: Films, overlays: Overlays, pixel: number) => ArrowScale[];
  /** Draws what has a size in pixels, for another size of a pixel, m. */
  scale: (pixel: number) => void;
  /** Moves bodies, arrows and highlights to a time, s. */
  pose: (time: number, pixel: number) => void;
  /** Moves the bodies of all films but the simulated one. */
  poseOthers: (time: number) => void;
}

/** The layers of films over a picture. */
export function filmLayers(scene: Scene, drawing: Picture): FilmLayers {
  const colourOf = colours(scene);
  const marks = { trails: s("g"), dots: s("g"), rings: s("g") };
  const arrowLayer = arrows();
  drawing.over.append(marks.trails, marks.dots, marks.rings, arrowLayer.group);
  let films: Films = { simulated: null, real: null, compared: null };
  let [rings, impact]: [{ t: number; ring: SVGCircleElement }[], boolean] = [[], false];
  const path = (film: Film | null, look: string): SVGElement[] => (film ? trails(film, look, (name) => colourOf.get(name) ?? "currentColor") : []);
  const at = (film: Film | null, time: number): Map<string, Pose> => (film ? posesAt(film, time) : new Map());
  const scale = (pixel: number): void => {
    put(marks.dots, ...(films.real ? dots(films.real, pixel) : []));
    rings = films.simulated ? contactRings(films.simulated, pixel, impact) : [];
    put(marks.rings, ...rings.map((r) => r.ring));
  };
  const poseOthers = (time: number): void => {
    drawing.pose("ghost", at(films.real, time));
    drawing.pose("other", at(films.compared, time));
  };
  return {
    load: (now, overlays, pixel) => {
      [films, impact] = [now, overlays.impact];
      put(marks.trails, ...path(films.compared, "trail other"), ...path(films.simulated, "trail"), ...path(films.real, "trail real"));
      scale(pixel);
      return arrowLayer.load(films.simulated, overlays);
    },
    scale,
    pose: (time, pixel) => {
      if (films.simulated) drawing.pose("solid", at(films.simulated, time));
      poseOthers(time);
      for (const { t, ring } of rings) ring.classList.toggle("lit", time >= t && time < t + CONTACT_HIGHLIGHT_S);
      arrowLayer.draw(time, pixel);
    },
    poseOthers,
  };
}
