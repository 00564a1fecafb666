// Force fields over the scene: what the base model lacks, what the extension adds, and what is left.

import { h } from "../../dom";
import type { Point, Scene } from "../../scene/types";
import { arrows, corners, over, spots } from "./over";
import { columnOf, type Report, type Table } from "./report";
import { digits } from "./words";

/** Square of a push over its standard deviations from which the data tell it: 95 % of chi squared of 2. */
const TOLD = 5.99;
/** Cells of the plane for what is missing. */
const [ACROSS, UP] = [10, 7];

interface Push {
  at: Point;
  push: Point;
}

/** What the base model lacks, and what the extension adds, by cells of the plane. */
export function fieldMissing(found: Report, scene: Scene): HTMLElement | null {
  const pushes = found.evidence?.pushes;
  if (!pushes?.rows.length) return null;
  const [lacks, adds] = [cells(pushes, "ax", "ay"), cells(pushes, "found_ax", "found_ay")];
  const any = adds.some((p) => Math.hypot(...p.push) > 0);
  const about = "Acceleration that the base model lacks along flights, the median of each cell";
  return drawn(scene, about, [[lacks, "arrow lacks", "lacking"], ...(any ? [[adds, "arrow adds", "what the extension adds"] as const] : [])]);
}

/** What pushes beside the reported model, with an arrow where the data tell it. */
export function fieldLeft(found: Report, scene: Scene): (HTMLElement | null)[] {
  if (!found.field) return [];
  const [x, y, ax, ay, sx, sy] = ["x", "y", "ax", "ay", "sd_ax", "sd_ay"].map((name) => columnOf(found.field!, name)) as [number[], number[], number[], number[], number[], number[]];
  const all = x.map((v, i) => ({ at: [v, y[i]!] as Point, push: [ax[i]!, ay[i]!] as Point, told: (ax[i]! / sx[i]!) ** 2 + (ay[i]! / sy[i]!) ** 2 > TOLD }));
  const told = all.filter((p) => p.told);
  if (!told.length) return [h("p", {}, "Nowhere do the data tell a push that launches share beside the reported model.")];
  const about = "What pushes beside the reported model, per mass; dots where nothing is told";
  return [drawn(scene, about, [[told, "arrow left", "left"]], all.filter((p) => !p.told).map((p) => p.at))];
}

/** Arrows over a scene with their scale in words. */
function drawn(scene: Scene, about: string, of: readonly (readonly [Push[], string, string])[], quiet: readonly Point[] = []): HTMLElement {
  const all = [...of.flatMap(([pushes]) => pushes.map((p) => p.at)), ...quiet];
  const most = Math.max(...of.flatMap(([pushes]) => pushes.map((p) => Math.hypot(...p.push))));
  const [low, high] = corners(all);
  const size = low && high ? Math.max(high[0] - low[0], high[1] - low[1]) : 1;
  // The longest reaches about as far as the next cell.
  const per = most > 0 ? (0.12 * size) / most : 0;
  const tips = of.flatMap(([pushes]) => pushes.map((p): Point => [p.at[0] + per * p.push[0], p.at[1] + per * p.push[1]]));
  const key = h("div", { class: "row keys" }, ...of.map(([, look, name]) => h("span", { class: `key swatch ${look}` }, name)));
  const picture = over(scene, about, [...all, ...tips], [...of.map(([pushes, look]) => arrows(pushes, per, look)), spots(quiet, "quiet-spot")], `The longest arrow is ${digits(most)} m/s².`);
  return h("div", { class: "stack" }, h("h3", {}, about), key, picture.element);
}

/** For each cell with anything in it the mean place and the median push. */
export function cells(pushes: Table, ax: string, ay: string): Push[] {
  const of = ["x", "y", ax, ay].map((name) => columnOf(pushes, name)) as [number[], number[], number[], number[]];
  const rows = of[0].map((_, i) => of.map((c) => c[i]!)).filter((r) => r.every(Number.isFinite));
  const span = corners(rows.map((r): Point => [r[0]!, r[1]!]));
  if (span.length < 2) return [];
  const filled = new Map<number, number[][]>();
  for (const row of rows) {
    const cell = (k: 0 | 1, count: number): number => Math.min(count - 1, Math.floor(((row[k]! - span[0]![k]) / Math.max(1e-12, span[1]![k] - span[0]![k])) * count));
    const key = cell(1, UP) * ACROSS + cell(0, ACROSS);
    filled.set(key, [...(filled.get(key) ?? []), row]);
  }
  const mean = (own: number[][], k: number): number => own.reduce((sum, r) => sum + r[k]!, 0) / own.length;
  const median = (own: number[][], k: number): number => {
    const sorted = own.map((r) => r[k]!).sort((a, b) => a - b);
    return 0.5 * (sorted[(sorted.length - 1) >> 1]! + sorted[sorted.length >> 1]!);
  };
  return [...filled.values()].map((own) => ({ at: [mean(own, 0), mean(own, 1)], push: [median(own, 2), median(own, 3)] }));
}
