// Acceleration fields over the scene: missing in the base model, added by the extension, and residual.

import { h } from "../../dom";
import type { Point, Scene } from "../../scene/types";
import { arrows, corners, overlay, dotElements } from "./overlay";
import { columnOf, type Report, type Table } from "./report";
import { digits } from "./messages";

/** 95 % quantile of the chi-squared distribution with 2 degrees of freedom: threshold of a significant acceleration. */
const CHI2_2_QUANTILE_95 = 5.99;
/** Grid cells of the field of missing acceleration. */
const [COLUMNS, ROWS] = [10, 7];

interface AccelerationArrow {
  at: Point;
  push: Point;
}

/** Acceleration missing in the base model and added by the extension, by grid cell. */
export function missingAccelerationField(report: Report, scene: Scene): HTMLElement | null {
  const pushes = report.evidence?.pushes;
  if (!pushes?.rows.length) return null;
  const [missing, added] = [cells(pushes, "ax", "ay"), cells(pushes, "found_ax", "found_ay")];
  const any = added.some((p) => Math.hypot(...p.push) > 0);
  const about = "Acceleration missing in the base model, median of each cell";
  return arrowPlot(scene, about, [[missing, "arrow lacks", "missing"], ...(any ? [[added, "arrow adds", "added by the extension"] as const] : [])]);
}

/** Residual acceleration of the reported model, with arrows where it is significant. */
export function residualField(report: Report, scene: Scene): (HTMLElement | null)[] {
  if (!report.field) return [];
  const [x, y, ax, ay, sx, sy] = ["x", "y", "ax", "ay", "sd_ax", "sd_ay"].map((name) => columnOf(report.field!, name)) as [number[], number[], number[], number[], number[], number[]];
  const all = x.map((v, i) => ({ at: [v, y[i]!] as Point, push: [ax[i]!, ay[i]!] as Point, told: (ax[i]! / sx[i]!) ** 2 + (ay[i]! / sy[i]!) ** 2 > CHI2_2_QUANTILE_95 }));
  const significant = all.filter((p) => p.told);
  if (!significant.length) return [h("p", {}, "No further common force is visible in the data.")];
  const about = "Residual acceleration of the reported model; dots where it is not significant";
  return [arrowPlot(scene, about, [[significant, "arrow left", "left"]], all.filter((p) => !p.told).map((p) => p.at))];
}

/** Arrows over a scene, with their scale. */
function arrowPlot(scene: Scene, about: string, of: readonly (readonly [AccelerationArrow[], string, string])[], insignificant: readonly Point[] = []): HTMLElement {
  const all = [...of.flatMap(([pushes]) => pushes.map((p) => p.at)), ...insignificant];
  const largest = Math.max(...of.flatMap(([pushes]) => pushes.map((p) => Math.hypot(...p.push))));
  const [low, high] = corners(all);
  const size = low && high ? Math.max(high[0] - low[0], high[1] - low[1]) : 1;
  // The longest arrow reaches about the next cell.
  const scale = largest > 0 ? (0.12 * size) / largest : 0;
  const tips = of.flatMap(([pushes]) => pushes.map((p): Point => [p.at[0] + scale * p.push[0], p.at[1] + scale * p.push[1]]));
  const key = h("div", { class: "row keys" }, ...of.map(([, look, name]) => h("span", { class: `key swatch ${look}` }, name)));
  const picture = overlay(scene, about, [...all, ...tips], [...of.map(([pushes, look]) => arrows(pushes, scale, look)), dotElements(insignificant, "quiet-spot")], `The longest arrow is ${digits(largest)} m/s².`);
  return h("div", { class: "stack" }, h("h3", {}, about), key, picture.element);
}

/** Mean position and median acceleration of each non-empty cell. */
export function cells(pushes: Table, ax: string, ay: string): AccelerationArrow[] {
  const of = ["x", "y", ax, ay].map((name) => columnOf(pushes, name)) as [number[], number[], number[], number[]];
  const rows = of[0].map((_, i) => of.map((c) => c[i]!)).filter((r) => r.every(Number.isFinite));
  const span = corners(rows.map((r): Point => [r[0]!, r[1]!]));
  if (span.length < 2) return [];
  const cellRows = new Map<number, number[][]>();
  for (const row of rows) {
    const cell = (k: 0 | 1, count: number): number => Math.min(count - 1, Math.floor(((row[k]! - span[0]![k]) / Math.max(1e-12, span[1]![k] - span[0]![k])) * count));
    const key = cell(1, ROWS) * COLUMNS + cell(0, COLUMNS);
    cellRows.set(key, [...(cellRows.get(key) ?? []), row]);
  }
  const mean = (rowsOfCell: number[][], k: number): number => rowsOfCell.reduce((sum, r) => sum + r[k]!, 0) / rowsOfCell.length;
  const median = (rowsOfCell: number[][], k: number): number => {
    const sorted = rowsOfCell.map((r) => r[k]!).sort((a, b) => a - b);
    return 0.5 * (sorted[(sorted.length - 1) >> 1]! + sorted[sorted.length >> 1]!);
  };
  return [...cellRows.values()].map((rowsOfCell) => ({ at: [mean(rowsOfCell, 0), mean(rowsOfCell, 1)], push: [median(rowsOfCell, 2), median(rowsOfCell, 3)] }));
}
