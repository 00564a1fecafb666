// Line plots over time in SVG: axes, lines, marks, and a cursor that follows the film.

import { put, s, set } from "../dom";
import { short } from "./slider";

export interface TimeSeries {
  name: string;
  colour: string;
  x: readonly number[];
  y: readonly number[];
}

export interface TimePlot {
  svg: SVGSVGElement;
  draw: (lines: readonly TimeSeries[], marks?: readonly number[]) => void;
  /** Moves the cursor. */
  at: (x: number) => void;
}

const [HEIGHT, LEFT, BOTTOM, TOP, RIGHT] = [170, 44, 34, 10, 12];
/** Width of an axis label, px. */
const LABEL = 60;

/** A plot; `onPick` is called with the time at the pointer. */
export function timePlot(labels: { about: string; x: string; y: string }, onPick?: (x: number) => void): TimePlot {
  const plot = s("g");
  const cursor = s("line", { class: "cursor", y1: TOP, y2: HEIGHT - BOTTOM, visibility: "hidden" });
  const svg = s("svg", { class: "curve", role: "img", height: HEIGHT }, plot, cursor);
  let [last, highest, width, cursorX] = [1, 1, 720, 0];
  let current: { lines: readonly TimeSeries[]; marks: readonly number[] } = { lines: [], marks: [] };
  const x = (v: number): number => LEFT + (v / last) * (width - LEFT - RIGHT);
  const y = (v: number): number => HEIGHT - BOTTOM - (v / highest) * (HEIGHT - BOTTOM - TOP);
  const draw = (lines: readonly TimeSeries[], marks: readonly number[] = []): void => {
    current = { lines, marks };
    last = Math.max(1e-9, ...lines.map((l) => l.x.at(-1) ?? 0));
    const steps = ticks(Math.max(1e-3, ...lines.flatMap((l) => l.y.filter(Number.isFinite))), 4);
    highest = steps.at(-1)!;
    const rows = steps.map((v) => [
      s("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: y(v), y2: y(v) }),
      s("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, tickLabel(v)),
    ]);
    const columns = ticks(last, Math.max(3, Math.floor(width / LABEL))).filter((v) => v <= last).map((v) => s("text", { x: x(v), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, tickLabel(v)));
    const curves = lines.map((l) => {
      const points = l.y.map((v, k) => `${x(l.x[k]!).toFixed(1)},${y(v).toFixed(1)}`).join(" ");
      return s("polyline", { points, fill: "none", stroke: l.colour, "stroke-width": 2.5 });
    });
    const pins = marks.filter((m) => m <= last).map((m) => s("line", { class: "mark", x1: x(m), x2: x(m), y1: HEIGHT - BOTTOM - 7, y2: HEIGHT - BOTTOM }));
    const names = [
      s("text", { x: width - RIGHT, y: HEIGHT - 4, "text-anchor": "end" }, labels.x),
      s("text", { x: LEFT, y: HEIGHT - 4 }, labels.y),
    ];
    put(plot, ...rows.flat(), ...columns, ...pins, ...curves, ...names);
    const ends = lines.map((l) => `${l.name} ${short(l.y.at(-1) ?? 0)} at the end, ${short(Math.max(0, ...l.y))} at most`);
    set(svg, { "aria-label": `${labels.about}: ${ends.join("; ")}` });
    at(cursorX);
  };
  const at = (v: number): void => {
    cursorX = v;
    set(cursor, { x1: x(Math.min(v, last)), x2: x(Math.min(v, last)), visibility: "visible" });
  };
  if (onPick) {
    const pick = (event: PointerEvent): void => {
      const box = svg.getBoundingClientRect();
      const px = event.clientX - box.left;
      onPick(Math.max(0, ((px - LEFT) / (width - LEFT - RIGHT)) * last));
    };
    svg.addEventListener("pointerdown", (event) => (svg.setPointerCapture(event.pointerId), pick(event)));
    svg.addEventListener("pointermove", (event) => event.buttons && pick(event));
  }
  // One unit is one pixel at any width, so that labels stay readable.
  new ResizeObserver(([entry]) => {
    width = Math.max(240, entry?.contentRect.width ?? width);
    set(svg, { viewBox: `0 0 ${width} ${HEIGHT}` });
    draw(current.lines, current.marks);
  }).observe(svg);
  return { svg, draw, at };
}

/** A tick label without rounding errors. */
export function tickLabel(v: number): string {
  return String(Number(v.toPrecision(6)));
}

/** Ticks from 0 to at least `most`, about `count` of them. */
export function ticks(most: number, count: number): number[] {
  const rough = most / count;
  const ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * ten).find((v) => v >= rough * 0.999)!;
  return Array.from({ length: Math.ceil(most / step - 1e-9) + 1 }, (_, k) => k * step);
}
