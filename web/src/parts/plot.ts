// Plots on canvas: dots with intervals, lines with bands, labelled axes. Drawn when they become visible, and again after changes
// of size or theme.

import { h, put, s } from "../dom";

export interface PlotSeries {
  name: string;
  look: "dots" | "line" | "band";
  /** A CSS variable of tokens.css: `--simulated`. */
  colour: string;
  x: readonly number[];
  y: readonly number[];
  /** Interval of each value: error bars for dots, a band for lines. */
  low?: readonly number[];
  high?: readonly number[];
  dashed?: boolean;
}

export interface PlotAxes {
  /** Heading, and text for screen readers. */
  title: string;
  x: string;
  y: string;
  /** Caption. */
  note?: string;
  /** Whether x is an integer count. */
  counts?: boolean;
}

const [HEIGHT, LEFT, BOTTOM, TOP, RIGHT] = [260, 62, 40, 10, 14];
/** Margin at both ends of a range, share. */
const MARGIN = 0.04;
const DOT_RADIUS_PX = 2.2;

/** A figure that redraws itself until `signal` aborts. */
export function plot(axes: PlotAxes, series: readonly PlotSeries[], signal: AbortSignal): HTMLElement {
  const canvas = h("canvas", { role: "img", "aria-label": describe(axes, series), height: HEIGHT });
  const draw = (): void => {
    const width = Math.round(canvas.clientWidth);
    if (width > 0) paint(canvas, width, axes, series);
  };
  drawWhenVisible(canvas, draw, signal);
  return h(
    "figure",
    { class: "plot" },
    h("figcaption", {}, h("strong", {}, axes.title), axes.note ? h("span", { class: "soft" }, ` ${axes.note}`) : null),
    h("div", { class: "row keys" }, ...series.map(key)),
    canvas,
  );
}

/** Calls `draw` when an element first becomes visible, and after changes of its size or of the theme. */
function drawWhenVisible(element: HTMLElement, draw: () => void, signal: AbortSignal): void {
  let isVisible = false;
  const redraw = (): void => void (isVisible && requestAnimationFrame(draw));
  const visibility = new IntersectionObserver((entries) => {
    if (isVisible || !entries.some((e) => e.isIntersecting)) return;
    isVisible = true;
    redraw();
  }, { rootMargin: "100px" });
  const [size, theme] = [new ResizeObserver(redraw), new MutationObserver(redraw)];
  visibility.observe(element);
  size.observe(element);
  theme.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw, { signal });
  signal.addEventListener("abort", () => [visibility, size, theme].forEach((o) => o.disconnect()));
}

/** Minimum and maximum of numbers; `null` without any. */
export function range(...lists: readonly (readonly number[])[]): [number, number] | null {
  let [low, high] = [Infinity, -Infinity];
  for (const list of lists) {
    for (const v of list) {
      if (!Number.isFinite(v)) continue;
      low = Math.min(low, v);
      high = Math.max(high, v);
    }
  }
  return low <= high ? [low, high] : null;
}

/** Round numbers within a range, about `count` of them. */
export function marks(low: number, high: number, count: number): number[] {
  const rough = Math.max(high - low, 1e-12) / Math.max(1, count);
  const ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * ten).find((v) => v >= rough * 0.999)!;
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, k) => Number(((first + k) * step).toPrecision(12)));
}

interface PlotFrame {
  at: CanvasRenderingContext2D;
  x: (v: number) => number;
  y: (v: number) => number;
  width: number;
  colour: (name: string) => string;
}

function paint(canvas: HTMLCanvasElement, width: number, axes: PlotAxes, series: readonly PlotSeries[]): void {
  const ratio = devicePixelRatio || 1;
  [canvas.width, canvas.height] = [width * ratio, HEIGHT * ratio];
  const at = canvas.getContext("2d");
  if (!at) return;
  at.scale(ratio, ratio);
  const [across, up] = [padded(range(...series.map((o) => o.x))), padded(range(...series.flatMap((o) => [o.y, o.low ?? [], o.high ?? []])))];
  const x = (v: number): number => LEFT + ((v - across[0]) / (across[1] - across[0])) * (width - LEFT - RIGHT);
  const y = (v: number): number => HEIGHT - BOTTOM - ((v - up[0]) / (up[1] - up[0])) * (HEIGHT - BOTTOM - TOP);
  const colour = (name: string): string => {
    canvas.style.color = `var(${name})`;
    return getComputedStyle(canvas).color;
  };
  const frame: PlotFrame = { at, x, y, width, colour };
  grid(frame, axes, across, up);
  at.save();
  at.beginPath();
  at.rect(LEFT, TOP, width - LEFT - RIGHT, HEIGHT - BOTTOM - TOP);
  at.clip();
  for (const one of series) if (one.look !== "dots") band(frame, one);
  for (const one of series) (one.look === "dots" ? dots : one.look === "line" ? lines : () => undefined)(frame, one);
  at.restore();
}

function padded(of: [number, number] | null): [number, number] {
  const [low, high] = of ?? [0, 1];
  const free = (high - low) * MARGIN || Math.abs(high) * 0.1 || 1;
  return [low - free, high + free];
}

function grid({ at, x, y, width, colour }: PlotFrame, axes: PlotAxes, across: [number, number], up: [number, number]): void {
  const [line, soft] = [colour("--line"), colour("--soft")];
  at.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  at.lineWidth = 1;
  at.fillStyle = soft;
  at.textAlign = "right";
  at.textBaseline = "middle";
  for (const v of marks(...up, 5)) {
    at.strokeStyle = v === 0 ? soft : line;
    stroke(at, [[LEFT, y(v)], [width - RIGHT, y(v)]]);
    at.fillText(plain(v), LEFT - 6, y(v));
  }
  at.textAlign = "center";
  at.textBaseline = "alphabetic";
  const columns = marks(...across, Math.max(4, Math.floor(width / 90))).filter((v) => !axes.counts || Number.isInteger(v));
  for (const v of columns) {
    at.strokeStyle = line;
    stroke(at, [[x(v), HEIGHT - BOTTOM], [x(v), HEIGHT - BOTTOM + 4]]);
    at.fillText(plain(v), x(v), HEIGHT - BOTTOM + 17);
  }
  at.fillText(axes.x, (LEFT + width - RIGHT) / 2, HEIGHT - 6);
  at.save();
  at.translate(12, (TOP + HEIGHT - BOTTOM) / 2);
  at.rotate(-Math.PI / 2);
  at.fillText(axes.y, 0, 0);
  at.restore();
}

function band({ at, x, y, colour }: PlotFrame, one: PlotSeries): void {
  if (!one.low || !one.high) return;
  const finite = one.x.map((_, i) => i).filter((i) => [one.x[i]!, one.low![i]!, one.high![i]!].every(Number.isFinite));
  if (!finite.length) return;
  at.fillStyle = colour(one.colour);
  at.globalAlpha = 0.16;
  at.beginPath();
  for (const i of finite) at.lineTo(x(one.x[i]!), y(one.low[i]!));
  for (const i of finite.reverse()) at.lineTo(x(one.x[i]!), y(one.high[i]!));
  at.fill();
  at.globalAlpha = 1;
}

function lines({ at, x, y, colour }: PlotFrame, one: PlotSeries): void {
  at.strokeStyle = colour(one.colour);
  at.lineWidth = 2;
  at.setLineDash(one.dashed ? [6, 4] : []);
  stroke(at, one.x.map((v, i): [number, number] => [x(v), y(one.y[i]!)]).filter((p) => p.every(Number.isFinite)));
  at.setLineDash([]);
}

function dots({ at, x, y, colour }: PlotFrame, one: PlotSeries): void {
  at.fillStyle = at.strokeStyle = colour(one.colour);
  at.lineWidth = 1.5;
  // Dots overlap.
  at.globalAlpha = one.x.length > 400 ? 0.5 : 1;
  if (one.low && one.high) one.x.forEach((v, i) => stroke(at, [[x(v), y(one.low![i]!)], [x(v), y(one.high![i]!)]]));
  for (let i = 0; i < one.x.length; i++) {
    const [px, py] = [x(one.x[i]!), y(one.y[i]!)];
    if (!Number.isFinite(px) || !Number.isFinite(py)) continue;
    const size = one.low ? DOT_RADIUS_PX + 1 : DOT_RADIUS_PX;
    if (one.dashed) {
      at.lineWidth = 1.2;
      at.strokeRect(px - size, py - size, 2 * size, 2 * size);
    } else {
      at.beginPath();
      at.arc(px, py, size, 0, 2 * Math.PI);
      at.fill();
    }
  }
  at.globalAlpha = 1;
}

function stroke(at: CanvasRenderingContext2D, points: readonly (readonly [number, number])[]): void {
  at.beginPath();
  for (const [px, py] of points) at.lineTo(px, py);
  at.stroke();
}

function key(one: PlotSeries): HTMLElement {
  const swatch = s("svg", { width: 22, height: 12, "aria-hidden": "true" });
  const paint = { stroke: `var(${one.colour})`, fill: "none" };
  const bandSwatch = one.low && one.look !== "dots" ? s("rect", { width: 22, height: 12, fill: `var(${one.colour})`, "fill-opacity": 0.2 }) : null;
  const bar = one.low && one.look === "dots" ? s("line", { x1: 11, x2: 11, y1: 0, y2: 12, ...paint }) : null;
  const line = one.look === "line" ? s("line", { x1: 0, x2: 22, y1: 6, y2: 6, "stroke-width": 2.5, "stroke-dasharray": one.dashed ? "6 4" : null, ...paint }) : null;
  const square = s("rect", { x: 8, y: 3, width: 6, height: 6, ...paint });
  const dot = one.look !== "dots" ? null : one.dashed ? square : s("circle", { cx: 11, cy: 6, r: 3, fill: `var(${one.colour})` });
  return h("span", { class: "key" }, put(swatch, bandSwatch, bar, line, dot), one.name);
}

function plain(v: number): string {
  const size = Math.abs(v);
  return size !== 0 && (size >= 1e5 || size < 1e-4) ? v.toExponential(1) : String(Number(v.toPrecision(4)));
}

function describe(axes: PlotAxes, series: readonly PlotSeries[]): string {
  const each = series.map((one) => {
    const of = range(one.y);
    return of ? `${one.name}: ${one.x.length} from ${plain(of[0])} to ${plain(of[1])}` : `${one.name}: none`;
  });
  return `${axes.title}: ${axes.y} over ${axes.x}. ${each.join("; ")}.`;
}
