// Line plots with bands in SVG: several series, linear or logarithmic x axis, as lines, steps or points. The number of a series
// selects its colour and dash in the style sheet (`series-3`), in the plot and in its `key`.

import { put, s, set } from "../dom";
import { tickLabel, ticks } from "./timePlot";
import { short } from "./slider";

export interface CurveSeries {
  name: string;
  /** Number of its colour and dash. */
  look: number;
  x: readonly number[];
  y: readonly number[];
  /** Interval of each value. */
  low?: readonly number[];
  high?: readonly number[];
  /** Drawn lightly. */
  faint?: boolean;
}

export interface CurveAxes {
  /** Title for screen readers. */
  about: string;
  x: string;
  y: string;
  /** Whether the x axis is logarithmic, from 1. */
  log?: boolean;
  /** Whether a value holds until the next. */
  steps?: boolean;
  /** Whether points are marked. */
  marked?: boolean;
  /** Maximum of the y axis. */
  most?: number;
}

const [HEIGHT, LEFT, BOTTOM, TOP, RIGHT] = [230, 44, 38, 10, 14];
/** Width of an x axis label, px. */
const LABEL = 64;
/** Number of colours and dashes in the style sheet. */
export const SERIES_STYLES = 8;

/** A plot; `draw` displays other series, `last` is the minimum end of the x axis. */
export function curvePlot(axes: CurveAxes): { svg: SVGSVGElement; draw: (series: readonly CurveSeries[], last?: number) => void } {
  const plot = s("g");
  const svg = s("svg", { class: "curve plotted", role: "img", height: HEIGHT }, plot);
  let width = 560;
  let current: { series: readonly CurveSeries[]; last: number } = { series: [], last: 1 };
  const draw = (series: readonly CurveSeries[], last = 1): void => {
    current = { series, last };
    put(plot, ...elementsOf(axes, series, last, width));
    const ends = series.filter((one) => !one.faint).map((one) => `${one.name} ${short(one.y.at(-1) ?? 0)} at ${one.x.at(-1) ?? 0}`);
    set(svg, { "aria-label": `${axes.about}: ${ends.length ? ends.join("; ") : "no data yet"}` });
  };
  new ResizeObserver(([entry]) => {
    width = Math.max(240, entry?.contentRect.width ?? width);
    set(svg, { viewBox: `0 0 ${width} ${HEIGHT}` });
    draw(current.series, current.last);
  }).observe(svg);
  return { svg, draw };
}

/** Legend line of a series. */
export function key(look: number): SVGElement {
  return s("svg", { class: `series series-${look % SERIES_STYLES}`, width: 26, height: 10, "aria-hidden": "true" }, s("line", { class: "series-line", x1: 1, x2: 25, y1: 5, y2: 5 }));
}

function elementsOf(axes: CurveAxes, series: readonly CurveSeries[], least: number, width: number): SVGElement[] {
  const last = Math.max(least, ...series.map((one) => one.x.at(-1) ?? 0));
  const rows = ticks(axes.most ?? Math.max(1e-3, ...series.flatMap((one) => one.y.filter(Number.isFinite))), 4);
  const highest = rows.at(-1)!;
  const share = (v: number): number => (axes.log ? Math.log(Math.max(1, v)) / Math.log(Math.max(2, last)) : v / last);
  const x = (v: number): number => LEFT + share(v) * (width - LEFT - RIGHT);
  const y = (v: number): number => HEIGHT - BOTTOM - (v / highest) * (HEIGHT - BOTTOM - TOP);
  const point = (a: number, b: number): string => `${x(a).toFixed(1)},${y(b).toFixed(1)}`;
  const polylinePoints = (xs: readonly number[], ys: readonly number[]): string[] =>
    ys.flatMap((v, k) => (axes.steps && k > 0 ? [point(xs[k]!, ys[k - 1]!), point(xs[k]!, v)] : [point(xs[k]!, v)]));
  const grid = rows.flatMap((v) => [
    s("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(v), y2: y(v) }),
    s("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, tickLabel(v)),
  ]);
  const count = Math.max(3, Math.floor(width / LABEL));
  const at = axes.log ? decades(last) : ticks(last, count).filter((v) => v <= last * 1.001);
  const columns = at.map((v) => s("text", { x: x(v), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, tickLabel(v)));
  const areas = series.map((one) => {
    if (!one.low || !one.high) return null;
    const outline = [...polylinePoints(one.x, one.high), ...polylinePoints(one.x, one.low).reverse()].join(" ");
    return s("polygon", { class: `band series-${one.look % SERIES_STYLES}`, points: outline });
  });
  const lines = series.map((one) =>
    s(
      "g",
      { class: `series series-${one.look % SERIES_STYLES}${one.faint ? " faint" : ""}`, "data-series": one.name, "data-points": one.x.length },
      s("polyline", { class: "series-line", points: polylinePoints(one.x, one.y).join(" ") }),
      ...(axes.marked ? one.y.map((v, k) => s("circle", { class: "series-point", cx: x(one.x[k]!), cy: y(v), r: 3 })) : []),
    ),
  );
  const names = [
    s("text", { x: width - RIGHT, y: HEIGHT - 6, "text-anchor": "end" }, axes.x),
    s("text", { x: LEFT, y: HEIGHT - 6 }, axes.y),
  ];
  return [...grid, ...columns, ...areas.filter((a) => a !== null), ...lines, ...names];
}

/** 1, 2, 5, 10, ... up to `last`. */
function decades(last: number): number[] {
  const ticks10: number[] = [];
  for (let ten = 1; ten <= last; ten *= 10) ticks10.push(...[1, 2, 5].map((m) => m * ten).filter((v) => v <= last));
  return ticks10;
}
