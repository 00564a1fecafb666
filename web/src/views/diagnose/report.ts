// The part of `iplw.diagnosis/2` (docs/reference/formats.md) that the page uses beside the report.

import { range } from "../../parts/plot";
import type { Box, Point, Scene } from "../../scene/types";

export interface Parameter {
  name: string;
  value: number;
  setting: string | null;
}

export interface Effect {
  name: string;
  parameters: Parameter[];
}

/** Errors on held-out trials, m. */
export interface HeldOut {
  base_rmse: number;
  extended_rmse: number;
  floor_rmse: number;
}

/** Rows of numbers with column names; `null` for missing values. */
export interface Table {
  columns: string[];
  rows: (number | null)[][];
}

export interface Report {
  verdict: "none" | "named" | "ambiguous" | "unknown" | "insufficient_data";
  effects: Effect[];
  /** Misfit of the base model, m; missing with too little data. */
  residual: { base_rmse: number; floor_rmse: number } | null;
  gain: { held_out: HeldOut | null };
  /** The trials by the names of the user. */
  launches: { trial: number; name: string; setting: string | null }[];
  predictive: { launches: { trial: number; p: number }[] } | null;
  paths: { columns: string[]; launches: { trial: number; rows: (number | null)[][] }[] };
  /** Missing in results of earlier versions. */
  extended_scene?: Scene;
  next_scene?: Scene | null;
}

/** A column of a table; NaN for missing values. */
export function columnOf(table: Table, name: string): number[] {
  const i = table.columns.indexOf(name);
  return table.rows.map((row) => (i < 0 ? null : row[i]) ?? Number.NaN);
}

/** Trajectory of a trial: observed, and predicted by both models. */
export interface TrialTrajectory {
  trial: number;
  t: number[];
  observed: Point[];
  /** Indices at which a new segment starts. */
  starts: number[];
  before: ModelPrediction;
  after: ModelPrediction;
}

export interface ModelPrediction {
  at: Point[];
  /** Measured minus simulated, m. */
  residual: Point[];
  /** Predictive standard deviations of the observations, m; NaN if unknown. */
  sd: Point[];
}

/** The trajectory of a trial; of the first body, if there are several. */
export function trajectoryOf(paths: Report["paths"], trial: number): TrialTrajectory | null {
  const rows = paths.launches.find((l) => l.trial === trial)?.rows ?? [];
  const body = paths.columns.indexOf("body");
  const table: Table = { columns: paths.columns, rows: rows.filter((r) => body < 0 || r[body] === rows[0]![body]) };
  if (!table.rows.length) return null;
  const pairs = (x: string, y: string): Point[] => {
    const [a, b] = [columnOf(table, x), columnOf(table, y)];
    return a.map((v, i): Point => [v, b[i]!]);
  };
  const observed = pairs("x", "y");
  const model = (side: string): ModelPrediction => {
    const residual = pairs(`${side}_x`, `${side}_y`);
    return { residual: residual, at: observed.map((p, i): Point => [p[0] - residual[i]![0], p[1] - residual[i]![1]]), sd: pairs(`sd_${side}_x`, `sd_${side}_y`) };
  };
  const stretch = columnOf(table, "stretch");
  const starts = stretch.flatMap((s, i) => (i > 0 && s !== stretch[i - 1] ? [i] : []));
  return { trial, t: columnOf(table, "t"), observed: observed, starts: starts, before: model("before"), after: model("after") };
}

/** Trials by their deviation from the prediction, largest first. */
export function trialsByDistance(report: Report): number[] {
  const ordered = [...(report.predictive?.launches ?? [])].sort((a, b) => a.p - b.p || a.trial - b.trial).map((l) => l.trial);
  return ordered.length ? ordered : report.paths.launches.map((l) => l.trial);
}

/** Visible box for a trial, m: the extent of all observations with a margin. */
export function extentOfTrials(report: Report): Box | null {
  const [x, y] = ["x", "y"].map((name) => report.paths.launches.flatMap((l) => columnOf({ columns: report.paths.columns, rows: l.rows }, name)));
  const [across, up] = [range(x!), range(y!)];
  if (!across || !up) return null;
  const pad = 0.08 * Math.max(across[1] - across[0], up[1] - up[0], 0.1);
  return [across[0] - pad, up[0] - pad, across[1] + pad, up[1] + pad];
}
