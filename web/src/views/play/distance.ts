// The distance of each body between two films over time.

import { h, put, s } from "../../dom";
import { timePlot } from "../../parts/timePlot";
import { short } from "../../parts/slider";
import { colours } from "../../scene/colour";
import { distanceOverTime, type Film } from "../../scene/film";
import type { Scene } from "../../scene/types";

export interface DistanceFigure {
  element: HTMLElement;
  /** Shows the distance of two films; hidden unless there are two. */
  show: (film: Film | null, from: Film | null) => void;
  at: (time: number) => void;
}

/** A figure that plots the distance, of class `look`; `seek` is called with a time picked in it. */
export function distanceFigure(title: string, look: string, scene: Scene, seek: (time: number) => void): DistanceFigure {
  const bodyColours = colours(scene);
  const plot = timePlot({ about: `${title}, m over s`, x: "s", y: "m apart" }, seek);
  const largest = h("span", { class: "soft" });
  const legend = scene.bodies.map((b) => h("span", { class: "key" }, swatch(bodyColours.get(b.name)!), b.name));
  const element = h("figure", { class: look, hidden: true }, h("figcaption", { class: "row" }, title, ...legend, largest), plot.svg);
  return {
    element,
    show: (film, from) => {
      element.hidden = !(film && from);
      if (!film || !from) return;
      const { t, bodies } = distanceOverTime(film, from);
      const lines = [...bodies].map(([name, y]) => ({ name, colour: bodyColours.get(name) ?? "currentColor", x: t, y }));
      plot.draw(lines, film.contacts.map((c) => c.t));
      const most = Math.max(0, ...lines.flatMap((l) => l.y));
      put(largest, most < 1e-9 ? "The same motion." : `At most ${short(most, "m")}.`);
    },
    at: plot.at,
  };
}

function swatch(colour: string): SVGElement {
  return s("svg", { width: 18, height: 10, "aria-hidden": "true" }, s("line", { x1: 0, x2: 18, y1: 5, y2: 5, stroke: colour, "stroke-width": 3 }));
}
