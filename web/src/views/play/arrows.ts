// Arrows of velocity and acceleration at the bodies of a film.

import { put, s } from "../../dom";
import { posesAt, type Film } from "../../scene/film";
import { accelerationAt, largest, velocityAt } from "../../scene/motion";
import { roundBelow } from "../../scene/viewControls";
import type { Point } from "../../scene/types";
import type { Overlays } from "./overlays";

/** Length of the longest arrow, its head and the legend's arrow, px; shorter arrows are not drawn. */
const [LONGEST_PX, HEAD_PX, SHORTEST_PX] = [110, 9, 3];

/** A kind of arrow with its scale. */
export interface ArrowScale {
  kind: "velocity" | "force";
  /** Value of the legend's arrow, SI, and its length, px. */
  value: number;
  length: number;
  unit: string;
}

export interface Arrows {
  group: SVGGElement;
  /** Scales the arrows to a film. */
  load: (film: Film | null, overlays: Overlays) => ArrowScale[];
  draw: (time: number, pixel: number) => void;
}

/** The arrows of a film. */
export function arrows(): Arrows {
  const group = s("g");
  let [film, scales]: [Film | null, ArrowScale[]] = [null, []];
  const of = { velocity: velocityAt, force: accelerationAt };
  const scale = (kind: "velocity" | "force", unit: string): ArrowScale[] => {
    const most = film ? largest(film, of[kind]) : 0;
    if (!(most > 1e-9)) return [];
    const value = roundBelow(most / 2);
    return [{ kind, value, unit, length: (value / most) * LONGEST_PX }];
  };
  return {
    group,
    load: (now, overlays) => {
      film = now;
      scales = [...(overlays.velocity ? scale("velocity", "m/s") : []), ...(overlays.force ? scale("force", "m/s²") : [])];
      return scales;
    },
    draw: (time, pixel) => {
      const currentFilm = film;
      if (!currentFilm || !scales.length) return void put(group);
      const poses = posesAt(currentFilm, time);
      const all = scales.flatMap(({ kind, value, length }) =>
        [...poses].map(([name, { x, y }]) => {
          const vector = of[kind](currentFilm, name, time);
          return vector && arrow([x, y], vector, (length / value) * pixel, pixel, kind);
        }),
      );
      put(group, ...all);
    },
  };
}

/** An arrow of a vector; `scale` in m per unit. */
function arrow([x, y]: Point, [vx, vy]: Point, scale: number, pixel: number, kind: string): SVGElement | null {
  const size = Math.hypot(vx, vy);
  if (size * scale < SHORTEST_PX * pixel) return null;
  const [ux, uy] = [vx / size, vy / size];
  const end: Point = [x + vx * scale, y + vy * scale];
  const head = Math.min(HEAD_PX * pixel, size * scale);
  const side = (sign: number): string => `${end[0] - head * (ux - 0.45 * sign * uy)} ${end[1] - head * (uy + 0.45 * sign * ux)}`;
  return s("path", { class: `arrow ${kind}`, d: `M${x} ${y}L${end[0]} ${end[1]}M${side(1)}L${end[0]} ${end[1]}L${side(-1)}`, "vector-effect": "non-scaling-stroke" });
}
