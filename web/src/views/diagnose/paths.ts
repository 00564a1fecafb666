// Launches before and after: all of them over the scene, one at a time with what the models predict of it.

import { h, put } from "../../dom";
import { choice } from "../../parts/field";
import { plot, type PlotSeries } from "../../parts/plot";
import type { Point, Scene } from "../../scene/types";
import { over, spots, strip, ways } from "./over";
import { play } from "./play";
import { byDistance, launched, type Model, type Report, way, type Way } from "./report";

/** Standard deviations to either side that a band is drawn over. */
const BAND = 2;

/** The choice of a launch, its path over the scene among all others, and its residuals. */
export function paths(found: Report, scene: Scene, signal: AbortSignal): HTMLElement[] {
  const order = byDistance(found).filter((trial) => way(found.paths, trial) !== null);
  if (!order.length) return [];
  const usual = order[order.length >> 1]!;
  const place = h("div", { class: "stack" });
  const names = new Map(found.launches.map((l) => [l.trial, l.name]));
  const named = (trial: number): string => (names.get(trial) === String(trial) ? `launch ${trial}` : `${trial}: ${names.get(trial) ?? "launch"}`);
  const mark = (trial: number): string => (found.predictive && trial === order[0] ? " (the furthest off)" : found.predictive && trial === usual ? " (the usual one)" : "");
  const options = [...order].sort((a, b) => a - b).map((t) => [String(t), `${named(t)}${mark(t)}`] as const);
  const show = (value: string): void => put(place, ...launch(found, scene, Number(value), signal)) && undefined;
  const field = choice("Launch", options, String(usual), show);
  const step = (text: string, by: number): HTMLElement => {
    const button = h("button", { type: "button" }, text);
    button.addEventListener("click", () => {
      const at = options.findIndex(([v]) => v === field.input.value);
      field.input.value = options[(at + by + options.length) % options.length]![0];
      show(field.input.value);
    });
    return button;
  };
  const furthest = h("button", { type: "button" }, "The furthest off");
  furthest.addEventListener("click", () => show((field.input.value = String(order[0]))));
  const enter = h("button", { type: "button" }, "Play this launch");
  enter.addEventListener("click", () => {
    const started = launched(found, Number(field.input.value));
    if (started) play(started, found);
  });
  show(String(usual));
  return [h("div", { class: "row" }, field.element, step("Before it", -1), step("After it", 1), found.predictive ? furthest : null, found.extended_scene ? enter : null), place];
}

function launch(found: Report, scene: Scene, trial: number, signal: AbortSignal): HTMLElement[] {
  const own = way(found.paths, trial);
  if (!own) return [];
  const others = found.paths.launches.map((l) => way(found.paths, l.trial)).filter((w) => w !== null);
  const pieces = others.flatMap((w) => cutAt(w.seen, w.begins));
  const drawn = [
    ways(pieces, "track other"),
    ...banded(own, own.before, "band before"),
    ...banded(own, own.after, "band after"),
    ways(cutAt(own.before.at, own.begins), "track before"),
    ways(cutAt(own.after.at, own.begins), "track after"),
    spots(own.seen, "seen-spot"),
  ];
  const label = `Launch ${trial}: seen, by the base model and by the extended one`;
  const key = h(
    "div",
    { class: "row keys" },
    h("span", { class: "key swatch seen" }, "seen"),
    h("span", { class: "key swatch before" }, "base model"),
    h("span", { class: "key swatch after" }, "extended model"),
    h("span", { class: "key swatch other" }, "other launches"),
  );
  const all = [...own.seen, ...own.before.at, ...own.after.at, ...pieces.flat()].filter((p) => p.every(Number.isFinite));
  const note = `Bands are ${BAND} standard deviations of what a model predicts of an observation.`;
  return [key, over(scene, label, all, drawn, note).element, h("div", { class: "pair" }, residual(own, 0, signal), residual(own, 1, signal))];
}

/** A band across a way: along its normal where it goes, by what is predicted there. */
function banded(own: Way, model: Model, look: string): (SVGElement | null)[] {
  const [low, high]: [Point[], Point[]] = [[], []];
  model.at.forEach((p, i) => {
    const [a, b] = [model.at[i - 1] ?? p, model.at[i + 1] ?? p];
    const long = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
    const [nx, ny] = [-(b[1] - a[1]) / long, (b[0] - a[0]) / long];
    const sd = Math.hypot(nx * model.sd[i]![0], ny * model.sd[i]![1]);
    low.push([p[0] - BAND * sd * nx, p[1] - BAND * sd * ny]);
    high.push([p[0] + BAND * sd * nx, p[1] + BAND * sd * ny]);
  });
  const [lows, highs] = [cutAt(low, own.begins), cutAt(high, own.begins)];
  return lows.map((piece, k) => (piece.concat(highs[k]!).flat().every(Number.isFinite) ? strip(piece, highs[k]!, look) : null));
}

function residual(own: Way, axis: 0 | 1, signal: AbortSignal): HTMLElement {
  const letter = "xy"[axis]!;
  const of = (name: string, colour: string, model: Model, dashed: boolean): PlotSeries[] => {
    const wide = model.sd.map((s) => BAND * s[axis]);
    return [
      { name: `${name}, predicted`, look: "band", colour, x: own.t, y: own.t.map(() => 0), low: wide.map((w) => -w), high: wide },
      { name, look: "dots", colour, dashed, x: own.t, y: model.off.map((p) => p[axis]) },
    ];
  };
  const series = [...of("base model", "--real", own.before, true), ...of("extended model", "--sim", own.after, false)];
  return plot({ title: `Launch ${own.trial}: residual in ${letter}`, x: "t, s", y: `seen less simulated ${letter}, m` }, series, signal);
}

/** Pieces of a list that begin at some places. */
export function cutAt<T>(list: readonly T[], begins: readonly number[]): T[][] {
  const edges = [0, ...begins, list.length];
  return edges.slice(1).map((end, k) => list.slice(edges[k]!, end));
}
