// Plots over rounds in SVG: estimates with intervals, of one or two estimations.

import { put, s, set } from "../dom";
import { short } from "./slider";

export interface EstimatePoint {
  /** Number of the round, from 1. */
  x: number;
  y: number;
  /** Ends of the interval; `null` if infinite, absent if there is none. */
  low?: number | null;
  high?: number | null;
}

export interface EstimateSeries {
  name: string;
  /** Style of the series. */
  look: "first" | "second";
  points: readonly EstimatePoint[];
}

export interface BandPlot {
  svg: SVGSVGElement;
  /** `rounds`: maximum number of rounds. */
  draw: (runs: readonly EstimateSeries[], rounds: number) => void;
}

const [HEIGHT, LEFT, BOTTOM, TOP, RIGHT] = [190, 52, 36, 12, 14];
/** Width of an axis label, px. */
const LABEL = 34;
/** Ticks of the y axis. */
const TICKS = 4;

/** A plot of estimates. Filled marks have a finite interval, hollow ones do not. */
export function bandPlot(labels: { about: string; y: string; logarithmic?: boolean }): BandPlot {
  const svg = s("svg", { class: "curve bands", role: "img", height: HEIGHT });
  let [width, last]: [number, { runs: readonly EstimateSeries[]; rounds: number }] = [420, { runs: [], rounds: 1 }];
  const draw = (runs: readonly EstimateSeries[], rounds: number): void => {
    last = { runs, rounds };
    const maxRound = Math.max(rounds, ...runs.flatMap((r) => r.points.map((p) => p.x)));
    const range = span(runs.flatMap((r) => r.points), labels.logarithmic ?? false);
    const x = (v: number): number => LEFT + (maxRound > 1 ? (v - 0.5) / maxRound : 0.5) * (width - LEFT - RIGHT);
    const share = (v: number): number => (labels.logarithmic ? Math.log(v / range.low) / Math.log(range.high / range.low) : (v - range.low) / (range.high - range.low));
    const y = (v: number): number => HEIGHT - BOTTOM - Math.min(1, Math.max(0, share(v))) * (HEIGHT - BOTTOM - TOP);
    const rows = range.ticks.flatMap((v) => [
      s("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(v), y2: y(v) }),
      s("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, plain(v)),
    ]);
    const every = Math.max(1, Math.ceil((maxRound * LABEL) / (width - LEFT - RIGHT)));
    const columns = Array.from({ length: maxRound }, (_, k) => k + 1)
      .filter((v) => v === 1 || v % every === 0)
      .map((v) => s("text", { x: x(v), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, v));
    const names = [s("text", { x: width - RIGHT, y: HEIGHT - 3, "text-anchor": "end" }, "round"), s("text", { x: 2, y: HEIGHT - 3 }, labels.y)];
    put(svg, ...rows, ...columns, ...names, ...runs.flatMap((run) => elementsOf(run, x, y)));
    set(svg, { viewBox: `0 0 ${width} ${HEIGHT}`, "aria-label": `${labels.about}. ${runs.map(describe).join(" ")}` });
  };
  // One unit is one pixel at any width, so that labels stay readable.
  new ResizeObserver(([entry]) => {
    width = Math.max(200, entry?.contentRect.width ?? width);
    draw(last.runs, last.rounds);
  }).observe(svg);
  return { svg, draw };
}

function elementsOf(run: EstimateSeries, x: (v: number) => number, y: (v: number) => number): SVGElement[] {
  const at = (v: number, u: number): string => `${x(v).toFixed(1)},${y(u).toFixed(1)}`;
  const isBounded = (p: EstimatePoint): p is EstimatePoint & { low: number; high: number } => typeof p.low === "number" && typeof p.high === "number";
  const areas = run.points.flatMap((p, k) => {
    const next = run.points[k + 1];
    if (!next || !isBounded(p) || !isBounded(next)) return [];
    const points = [at(p.x, p.low), at(next.x, next.low), at(next.x, next.high), at(p.x, p.high)].join(" ");
    return [s("polygon", { class: `band ${run.look}`, points })];
  });
  const bars = run.points.filter(isBounded).map((p) => s("line", { class: `bar ${run.look}`, x1: x(p.x), x2: x(p.x), y1: y(p.low), y2: y(p.high) }));
  const polyline = s("polyline", { class: `way ${run.look}`, points: run.points.map((p) => at(p.x, p.y)).join(" ") });
  const marks = run.points.map((p) => {
    const bounded = p.low === undefined || isBounded(p);
    return s("circle", { class: `dot ${run.look}${bounded ? "" : " untold"}`, cx: x(p.x), cy: y(p.y), r: 4 });
  });
  return [...areas, ...bars, polyline, ...marks];
}

/** Range of the y axis with ticks: all values and finite interval ends. */
export function span(points: readonly EstimatePoint[], logarithmic: boolean): { low: number; high: number; ticks: number[] } {
  const all = points.flatMap((p) => [p.y, p.low, p.high]).filter((v): v is number => typeof v === "number" && Number.isFinite(v));
  const values = logarithmic ? all.filter((v) => v > 0) : all;
  if (!values.length) return { low: logarithmic ? 0.1 : 0, high: 1, ticks: logarithmic ? [0.1, 1] : [0, 1] };
  const [least, maxRound] = [Math.min(...values), Math.max(...values)];
  if (logarithmic) {
    const [low, high] = [10 ** Math.floor(Math.log10(least)), 10 ** Math.max(Math.ceil(Math.log10(maxRound)), Math.floor(Math.log10(least)) + 1)];
    const decades = Math.round(Math.log10(high / low));
    const every = Math.ceil(decades / TICKS);
    return { low, high, ticks: Array.from({ length: Math.floor(decades / every) + 1 }, (_, k) => low * 10 ** (k * every)) };
  }
  const rough = Math.max(maxRound - least, 0.02 * Math.abs(maxRound), 1e-3) / TICKS;
  const ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * ten).find((v) => v >= rough * 0.999)!;
  const [first, count] = [Math.floor(least / step + 1e-9), Math.ceil(maxRound / step - 1e-9) - Math.floor(least / step + 1e-9)];
  const ticks = Array.from({ length: Math.max(1, count) + 1 }, (_, k) => (first + k) * step);
  return { low: ticks[0]!, high: ticks.at(-1)!, ticks };
}

/** Text of the last estimate. */
function describe(run: EstimateSeries): string {
  const last = run.points.at(-1);
  if (!last) return `${run.name}: no data yet.`;
  const within = typeof last.low === "number" && typeof last.high === "number" ? `, from ${short(last.low)} to ${short(last.high)}` : "";
  return `${run.name}: ${short(last.y)}${within} after round ${last.x}.`;
}

function plain(v: number): string {
  const text = Number(v.toPrecision(6));
  return Math.abs(text) >= 1e5 || (text !== 0 && Math.abs(text) < 1e-3) ? text.toExponential(0) : String(text);
}
