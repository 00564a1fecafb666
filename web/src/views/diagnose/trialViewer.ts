// The trials one by one: a selected one among all over the scene, with the predictions of both models and its residuals.

import { h, put } from "../../dom";
import { choice } from "../../parts/field";
import { plot, type PlotSeries } from "../../parts/plot";
import type { Point, Scene } from "../../scene/types";
import { overlay, dotElements, bandElement, pathElements } from "./overlay";
import type { Context } from "../../view";
import { playTrial } from "./extendedWorld";
import { trialName } from "./trialName";
import { trialsByDistance, type ModelPrediction, type Report, trajectoryOf, type TrialTrajectory } from "./report";
import { sceneOfTrial } from "./sceneOfTrial";

/** Half-width of a band in standard deviations. */
const BAND_SDS = 2;

/** A folded section: selection of a trial, its trajectory over the scene among all others, and its residuals. */
export function trialViewer(report: Report, context: Context): HTMLElement | null {
  const order = trialsByDistance(report).filter((trial) => trajectoryOf(report.paths, trial) !== null);
  if (!order.length) return null;
  const element = h("details", { class: "card trial-viewer" }, h("summary", {}, h("h2", {}, "Look at each trial"), h("span", { class: "soft" }, `${order.length} trials, measured and simulated`)));
  let isEmpty = true;
  element.addEventListener("toggle", () => {
    if (!element.open || !isEmpty) return;
    isEmpty = false;
    element.append(viewer(report, order, context));
  });
  return element;
}

/** `order`: trials by their deviation, largest first. */
function viewer(report: Report, order: readonly number[], context: Context): HTMLElement {
  const scene = report.extended_scene ?? { format: "iplw.scene/1" as const, bodies: [] };
  const medianTrial = order[order.length >> 1]!;
  const place = h("div", { class: "stack" });
  const names = new Map(report.launches.map((l) => [l.trial, trialName(l.name)]));
  const mark = (trial: number): string => (report.predictive && trial === order[0] ? " (largest deviation)" : report.predictive && trial === medianTrial ? " (median deviation)" : "");
  const nameOf = (trial: number): string => names.get(trial) ?? "unnamed";
  const options = [...order].sort((a, b) => a - b).map((t) => [String(t), `${nameOf(t)}${mark(t)}`] as const);
  const show = (value: string): void => put(place, ...trialView(report, scene, Number(value), nameOf(Number(value)), context.signal)) && undefined;
  const field = choice("Trial", options, String(medianTrial), show);
  const select = (value: string): void => {
    field.input.value = value;
    show(value);
    context.say(nameOf(Number(value)));
  };
  const button = (text: string, act: () => void): HTMLElement => {
    const element = h("button", { type: "button" }, text);
    element.addEventListener("click", act);
    return element;
  };
  const step = (by: number) => (): void => {
    const at = options.findIndex(([v]) => v === field.input.value);
    select(options[(at + by + options.length) % options.length]![0]);
  };
  show(String(medianTrial));
  const tools = [
    button("Previous trial", step(-1)),
    button("Next trial", step(1)),
    report.predictive ? button("Largest deviation", () => select(String(order[0]))) : null,
    report.extended_scene ? button("Play this trial", () => playTrial(report, Number(field.input.value))) : null,
  ];
  return h("div", { class: "stack" }, h("p", { class: "soft" }, "Each trial starts where it was measured to start. Compare its observations with both simulations."), h("div", { class: "row trial-tools" }, field.element, ...tools), place);
}

function trialView(report: Report, scene: Scene, trial: number, name: string, signal: AbortSignal): HTMLElement[] {
  const trajectory = trajectoryOf(report.paths, trial);
  if (!trajectory) return [];
  const others = report.paths.launches.map((l) => trajectoryOf(report.paths, l.trial)).filter((w) => w !== null);
  const pieces = others.flatMap((w) => splitAt(w.observed, w.starts));
  const elements = [
    pathElements(pieces, "track other"),
    ...bandElements(trajectory, trajectory.before, "band before"),
    ...bandElements(trajectory, trajectory.after, "band after"),
    pathElements(splitAt(trajectory.before.at, trajectory.starts), "track before"),
    pathElements(splitAt(trajectory.after.at, trajectory.starts), "track after"),
    dotElements(trajectory.observed, "observation"),
  ];
  const label = `${name}: measured, base model and extended model`;
  const key = h(
    "div",
    { class: "row keys" },
    h("span", { class: "key swatch observed" }, "measured"),
    h("span", { class: "key swatch before" }, "base model"),
    h("span", { class: "key swatch after" }, "extended model"),
    h("span", { class: "key swatch other" }, "other trials"),
  );
  const all = [...trajectory.observed, ...trajectory.before.at, ...trajectory.after.at, ...pieces.flat()].filter((p) => p.every(Number.isFinite));
  const note = `Bands: ${BAND_SDS} predictive standard deviations of an observation.`;
  return [key, overlay(sceneOfTrial(report, trial) ?? scene, label, all, elements, note).element, h("div", { class: "pair" }, residual(trajectory, name, 0, signal), residual(trajectory, name, 1, signal))];
}

/** A band across a trajectory: predictive standard deviation along the normal. */
function bandElements(trajectory: TrialTrajectory, model: ModelPrediction, look: string): (SVGElement | null)[] {
  const [low, high]: [Point[], Point[]] = [[], []];
  model.at.forEach((p, i) => {
    const [a, b] = [model.at[i - 1] ?? p, model.at[i + 1] ?? p];
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
    const [nx, ny] = [-(b[1] - a[1]) / length, (b[0] - a[0]) / length];
    const sd = Math.hypot(nx * model.sd[i]![0], ny * model.sd[i]![1]);
    low.push([p[0] - BAND_SDS * sd * nx, p[1] - BAND_SDS * sd * ny]);
    high.push([p[0] + BAND_SDS * sd * nx, p[1] + BAND_SDS * sd * ny]);
  });
  const [lows, highs] = [splitAt(low, trajectory.starts), splitAt(high, trajectory.starts)];
  return lows.map((piece, k) => (piece.concat(highs[k]!).flat().every(Number.isFinite) ? bandElement(piece, highs[k]!, look) : null));
}

function residual(trajectory: TrialTrajectory, trial: string, axis: 0 | 1, signal: AbortSignal): HTMLElement {
  const letter = "xy"[axis]!;
  const of = (name: string, colour: string, model: ModelPrediction, dashed: boolean): PlotSeries[] => {
    const bandWidths = model.sd.map((s) => BAND_SDS * s[axis]);
    return [
      { name: `${name}, predicted`, look: "band", colour, x: trajectory.t, y: trajectory.t.map(() => 0), low: bandWidths.map((w) => -w), high: bandWidths },
      { name, look: "dots", colour, dashed, x: trajectory.t, y: model.residual.map((p) => p[axis]) },
    ];
  };
  const series = [...of("base model", "--simulated", trajectory.before, true), ...of("extended model", "--extended", trajectory.after, false)];
  return plot({ title: `${trial}: residual in ${letter}`, x: "t, s", y: `measured - simulated ${letter}, m` }, series, signal);
}

/** A list split at indices. */
export function splitAt<T>(list: readonly T[], starts: readonly number[]): T[][] {
  const edges = [0, ...starts, list.length];
  return edges.slice(1).map((end, k) => list.slice(edges[k]!, end));
}
