// Tracks, trajectories and arrows over a scene, with a metric grid.

import { h, put, s } from "../../dom";
import { marks } from "../../parts/plot";
import { picture, type Picture } from "../../scene/draw";
import type { Box, Point, Scene } from "../../scene/types";
import { sceneExtent } from "../../scene/extent";

/** Minimum aspect ratio of a picture. */
const MIN_ASPECT = 1.8;

/** A scene with elements over it; the points `extra` are visible. */
export function overlay(scene: Scene, label: string, extra: readonly Point[], elements: readonly (SVGElement | null)[], note = ""): { element: HTMLElement; picture: Picture } {
  const box = widened(sceneExtent(scene, corners(extra)));
  const base = picture(scene, label, box);
  const { lines, step } = grid(box);
  put(base.under, ...lines);
  put(base.over, ...elements);
  put(base.svg, s("title", {}, label), ...base.svg.childNodes);
  const scale = `Grid lines are ${step} m apart; the bold ones are x = 0 and y = 0.`;
  return { element: h("figure", { class: "over" }, base.svg, h("figcaption", { class: "soft" }, note ? `${note} ` : "", scale)), picture: base };
}

/** Many paths as one element, for speed; `null` if there is nothing to draw. */
export function pathElements(points: readonly (readonly Point[])[], look: string): SVGElement | null {
  const text = points.filter((p) => p.length > 1).map((p) => `M${p.map(([x, y]) => `${short(x)} ${short(y)}`).join("L")}`);
  return text.length ? s("path", { class: look, d: text.join(""), fill: "none", "vector-effect": "non-scaling-stroke" }) : null;
}

/** Dots as one element: zero-length lines with round caps. */
export function dotElements(points: readonly Point[], look: string): SVGElement | null {
  const text = points.map(([x, y]) => `M${short(x)} ${short(y)}h0`).join("");
  return text ? s("path", { class: look, d: text, fill: "none", "stroke-linecap": "round", "vector-effect": "non-scaling-stroke" }) : null;
}

/** The area between two paths. */
export function bandElement(low: readonly Point[], high: readonly Point[], look: string): SVGElement | null {
  const extra = [...low, ...[...high].reverse()];
  return extra.length > 3 ? s("polygon", { class: look, points: extra.map(([x, y]) => `${short(x)},${short(y)}`).join(" ") }) : null;
}

/** Arrows with heads, `scale` metres for each unit. */
export function arrows(of: readonly { at: Point; push: Point }[], per: number, look: string): SVGElement | null {
  const heads = of.flatMap(({ at, push }) => {
    const [dx, dy] = [push[0] * per, push[1] * per];
    if (!(Math.hypot(dx, dy) > 0)) return [];
    const tip: Point = [at[0] + dx, at[1] + dy];
    const side = (turn: number): Point => [tip[0] - 0.3 * (dx - turn * dy), tip[1] - 0.3 * (dy + turn * dx)];
    return [[at, tip], [side(0.5), tip, side(-0.5)]];
  });
  return pathElements(heads as Point[][], look);
}

/** Lower left and upper right corner of the bounding box of points; empty without points. */
export function corners(points: readonly Point[]): Point[] {
  let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [x, y] of points) {
    [left, bottom, right, top] = [Math.min(left, x), Math.min(bottom, y), Math.max(right, x), Math.max(top, y)];
  }
  return left <= right && Number.isFinite(left + right + bottom + top) ? [[left, bottom], [right, top]] : [];
}

function widened(box: Box): Box {
  const widening = Math.max(0, MIN_ASPECT * (box[3] - box[1]) - (box[2] - box[0])) / 2;
  return [box[0] - widening, box[1], box[2] + widening, box[3]];
}

function grid(box: Box): { lines: SVGElement[]; step: number } {
  const [width, height] = [box[2] - box[0], box[3] - box[1]];
  const long = marks(0, Math.max(width, height), 12);
  const step = long[1] ?? 1;
  const line = (x1: number, y1: number, x2: number, y2: number, zero: boolean): SVGElement =>
    s("line", { class: zero ? "metre zero" : "metre", x1, y1, x2, y2, "vector-effect": "non-scaling-stroke" });
  const multiples = (low: number, high: number): number[] => {
    const [first, last] = [Math.ceil(low / step), Math.floor(high / step)];
    return Array.from({ length: Math.max(0, last - first + 1) }, (_, k) => (first + k) * step);
  };
  const columns = multiples(box[0], box[2]).map((v) => line(v, box[1], v, box[3], v === 0));
  return { lines: [...columns, ...multiples(box[1], box[3]).map((v) => line(box[0], v, box[2], v, v === 0))], step: Number(step.toPrecision(6)) };
}

/** Rounded to 0.01 mm; faster than toPrecision for many points. */
function short(v: number): number {
  return Math.round(v * 1e5) / 1e5;
}
