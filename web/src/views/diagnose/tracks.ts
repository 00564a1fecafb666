// Tracks in m and s with y up, and summary statistics.

import type { Point } from "../../scene/types";
import { LENGTHS, TIMES, unitNamed } from "./columns";
import { inVerticalPlanes } from "./verticalPlane";
import { type ColumnSelection, type ParsedFile, number } from "./parseFile";

/** Options that a file does not contain; empty if not given. */
export interface ReadingOptions {
  fps: number | null;
  metresPerPixel: number | null;
  lengthUnit: string;
  timeUnit: string;
  yDown: boolean | null;
  /** The axis that points up in files of three coordinates: `z`, `-y`; empty: the one along which the tracks fall. */
  up: string;
  track: string;
}

/** A trial of one body. */
export interface Track {
  trial: string;
  body: string;
  /** s */
  t: number[];
  /** m, y up */
  at: Point[];
}

export const NO_OPTIONS: ReadingOptions = { fps: null, metresPerPixel: null, lengthUnit: "", timeUnit: "", yDown: null, up: "", track: "" };

/** The tracks of a file. */
export function readTracks(of: ParsedFile, columns: ColumnSelection, options: ReadingOptions): Track[] {
  const [scale, tick, up] = [metresPerUnit(of, columns, options), secondsPerUnit(of, columns, options), options.yDown ? -1 : 1];
  const byName = new Map<string, Track & { index: number }>();
  const third: number[][] = [];
  const stem = of.name.replace(/\.[^.]*$/, "");
  for (const row of of.rows) {
    const [t, x, y] = [number(row[columns.clock]), number(row[columns.x]), number(row[columns.y])];
    const body = columns.body >= 0 ? (row[columns.body]?.trim() ?? "") : "";
    if (![t, x, y].every(Number.isFinite) || (options.track && columns.body >= 0 && body.toLowerCase() !== options.track.toLowerCase())) continue;
    const trial = columns.trial >= 0 ? (row[columns.trial]?.trim() ?? "") : stem;
    const key = `${trial}\n${body}`;
    let track = byName.get(key);
    if (!track) {
      byName.set(key, (track = { trial, body, t: [], at: [], index: third.length }));
      third.push([]);
    }
    track.t.push(t * tick);
    track.at.push([x * scale, up * y * scale]);
    third[track.index]!.push(columns.z < 0 ? 0 : number(row[columns.z]) * scale);
  }
  return inVerticalPlanes([...byName.values()], third, options.up);
}

/** Whether coordinates are in pixels and times in frames, so that their size is required. */
export function unitsUnknown(of: ParsedFile, columns: ColumnSelection): { pixels: boolean; pictures: boolean } {
  const clock = of.columns[columns.clock];
  return { pixels: of.columns[columns.x]?.unit?.size === null, pictures: clock?.quantity === "frame" || clock?.unit?.size === null };
}

/** Number of trials and samples, extent, duration, and upward acceleration, m/s^2. */
export interface TracksSummary {
  trials: number;
  samples: number;
  width: number;
  height: number;
  seconds: number;
  lowest: number;
  /** `null` if unknown. */
  upwardAcceleration: number | null;
}

export function summarise(tracks: readonly Track[]): TracksSummary {
  const [box, samples] = [[Infinity, Infinity, -Infinity, -Infinity] as [number, number, number, number], tracks.reduce((n, t) => n + t.t.length, 0)];
  for (const { at } of tracks) {
    for (const [x, y] of at) {
      box[0] = Math.min(box[0], x);
      box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], x);
      box[3] = Math.max(box[3], y);
    }
  }
  const seconds = tracks.reduce((most, { t }) => Math.max(most, (t.at(-1) ?? 0) - (t[0] ?? 0)), 0);
  const trials = new Set(tracks.map((t) => t.trial)).size;
  return { trials, samples, width: box[2] - box[0], height: box[3] - box[1], seconds, lowest: box[1], upwardAcceleration: upwardAcceleration(tracks) };
}

/** Maximum number of pieces of a track, and minimum number of samples in one. */
const [MAX_PIECES, MIN_SAMPLES_PER_PIECE] = [3, 8];

/** Median curvature of parabolas fitted to y over pieces of tracks; only the better half of the fits is used, to exclude
 * bounces. */
export function upwardAcceleration(tracks: readonly Track[]): number | null {
  const fits = tracks.flatMap(({ t, at }) => {
    const count = Math.max(1, Math.min(MAX_PIECES, Math.floor(t.length / MIN_SAMPLES_PER_PIECE)));
    return Array.from({ length: count }, (_, k) => {
      const [from, to] = [Math.floor((k * t.length) / count), Math.floor(((k + 1) * t.length) / count)];
      return fitParabola(t.slice(from, to), at.slice(from, to).map((p) => p[1]));
    }).filter((f) => f !== null);
  });
  fits.sort((a, b) => a.off - b.off);
  const best = fits.slice(0, Math.ceil(fits.length / 2)).map((f) => f.curve).sort((a, b) => a - b);
  return best.length ? best[best.length >> 1]! : null;
}

/** Second derivative of the least-squares parabola, and its mean squared residual. */
function fitParabola(t: readonly number[], y: readonly number[]): { curve: number; off: number } | null {
  const n = t.length;
  const middle = t.reduce((a, b) => a + b, 0) / n;
  const moment = (k: number): number => t.reduce((sum, v) => sum + (v - middle) ** k, 0) / n;
  const [m2, m3, m4] = [moment(2), moment(3), moment(4)];
  if (n < MIN_SAMPLES_PER_PIECE || m2 <= 0) return null;
  const basis = t.map((v) => (v - middle) ** 2 - m2 - (m3 / m2) * (v - middle));
  const square = m4 - m2 * m2 - (m3 * m3) / m2;
  if (square <= 1e-12 * m2 * m2) return null;
  const curvature = basis.reduce((sum, b, i) => sum + b * y[i]!, 0) / n / square;
  const mean = y.reduce((a, b) => a + b, 0) / n;
  const slope = t.reduce((sum, v, i) => sum + (v - middle) * y[i]!, 0) / n / m2;
  const misfit = y.reduce((sum, v, i) => sum + (v - mean - slope * (t[i]! - middle) - curvature * basis[i]!) ** 2, 0) / n;
  return { curve: 2 * curvature, off: misfit };
}

/** Minimum change of vertical velocity in a bounce: multiple of the median change between samples, and m/s. */
const MIN_BOUNCE_TURN = [8, 0.5] as const;

/** Heights of the centre at sharp upward turns: intersections of the parabolas before and after. */
export function bounceHeights(tracks: readonly Track[]): number[] {
  return tracks.flatMap(({ t, at }) => {
    const speed = (i: number): number => (at[i + 1]![1] - at[i]![1]) / (t[i + 1]! - t[i]!);
    const speeds = Array.from({ length: Math.max(0, t.length - 1) }, (_, i) => speed(i));
    const turns = speeds.slice(1).map((v, i) => v - speeds[i]!);
    const median = (of: number[]): number => of.sort((a, b) => a - b)[of.length >> 1] ?? 0;
    const sharp = Math.max(MIN_BOUNCE_TURN[1], MIN_BOUNCE_TURN[0] * median(turns.map(Math.abs)));
    const curvature = median(turns.map((v, i) => (2 * v) / (t[i + 2]! - t[i]!)));
    const turn = (i: number): number => (speeds[i + 1] ?? -Infinity) - speeds[i - 1]!;
    const heights: number[] = [];
    // The interval that contains the bounce lies between a falling and a rising one, with the largest difference.
    for (let i = 1; i + 1 < speeds.length; i++) {
      const [down, up] = [speeds[i - 1]!, speeds[i + 1]!];
      if (!(down < 0 && up > 0 && up - down > sharp) || turn(i + 1) > up - down) continue;
      const span = t[i + 1]! - t[i]!;
      // Speeds hold at the middle of their intervals.
      const before = down + 0.5 * curvature * (t[i]! - t[i - 1]!);
      const after = up - 0.5 * curvature * (t[i + 2]! - t[i + 1]!);
      const when = (at[i + 1]![1] - at[i]![1] - after * span + 0.5 * curvature * span * span) / (before - after + curvature * span);
      const since = Math.min(span, Math.max(0, when));
      heights.push(at[i]![1] + before * since + 0.5 * curvature * since * since);
      i += 1;
    }
    return heights;
  });
}

/** Height of the centre at contact with the ground; `null` if there are few bounces. */
export function typicalBounceHeight(tracks: readonly Track[]): number | null {
  const heights = bounceHeights(tracks).sort((a, b) => a - b);
  return heights.length > 1 && heights.length > tracks.length / 10 ? heights[heights.length >> 1]! : null;
}

function metresPerUnit(of: ParsedFile, columns: ColumnSelection, options: ReadingOptions): number {
  const unit = of.columns[columns.x]?.unit;
  if (options.metresPerPixel !== null && (!unit || unit.size === null)) return options.metresPerPixel;
  return unit?.size ?? (unitNamed(LENGTHS, options.lengthUnit)?.size || 1);
}

function secondsPerUnit(of: ParsedFile, columns: ColumnSelection, options: ReadingOptions): number {
  const clock = of.columns[columns.clock];
  const pictures = clock?.quantity === "frame" || clock?.unit?.size === null;
  if (options.fps !== null && (pictures || !clock?.unit)) return 1 / options.fps;
  return clock?.unit?.size ?? (unitNamed(TIMES, options.timeUnit)?.size || 1);
}
