// Tracks of three coordinates in the best vertical plane of each trial, as the server projects them
// (src/reality/track_files/vertical_plane.rs).

import type { Point } from "../../scene/types";
import { type Track, upwardAcceleration } from "./tracks";

export const UP_AXES = ["x", "y", "z", "-x", "-y", "-z"] as const;

/** Ratio of the accelerations along two axes above which the axis of the fall is clear. */
const MIN_FALL_RATIO = 3;
/** Horizontal extent, relative to the vertical one, below which a trial has no direction of its own. */
const MIN_HORIZONTAL_EXTENT = 0.02;

type Place = [number, number, number];

/** Tracks with distance along their plane and height, if the third coordinate, m, varies; otherwise as they are. */
export function inVerticalPlanes<T extends Track>(tracks: readonly T[], third: readonly (readonly number[])[], up: string): T[] {
  if (!hasThird(third)) return [...tracks];
  const places = tracks.map(({ at }, i) => at.map(([x, y], k): Place => [x, y, third[i]![k]!]));
  const axis = up || fallAxis(tracks, places) || "y";
  const index = "xyz".indexOf(axis.at(-1)!);
  const sign = axis.startsWith("-") ? -1 : 1;
  return tracks.map((track, i) => ({ ...track, at: project(places[i]!, index, sign) }));
}

/** Whether a third coordinate varies. */
export function hasThird(third: readonly (readonly number[])[]): boolean {
  return third.some((z) => z.some((v) => Number.isFinite(v) && v !== z[0]));
}

/** The axis along which the tracks fall, pointing up; `null` if none is clear. */
export function fallAxis(tracks: readonly Track[], places: readonly Place[][]): string | null {
  const falls = [0, 1, 2].map((k) => upwardAcceleration(tracks.map((t, i) => ({ ...t, at: places[i]!.map((p): Point => [0, p[k]!]) }))) ?? 0);
  const order = [0, 1, 2].sort((a, b) => Math.abs(falls[b]!) - Math.abs(falls[a]!));
  const [first, second] = [falls[order[0]!]!, falls[order[1]!]!];
  if (first === 0 || Math.abs(first) < MIN_FALL_RATIO * Math.abs(second)) return null;
  return `${first > 0 ? "-" : ""}${"xyz"[order[0]!]}`;
}

function project(places: readonly Place[], up: number, sign: number): Point[] {
  const [a, b] = [0, 1, 2].filter((k) => k !== up) as [number, number];
  const observations = places.filter((p) => p.every(Number.isFinite));
  const mean = (k: number): number => observations.reduce((sum, p) => sum + p[k]!, 0) / Math.max(1, observations.length);
  const centre = [mean(a), mean(b)] as const;
  const moment = (f: (p: Place) => number): number => observations.reduce((sum, p) => sum + f(p), 0);
  const [u, v] = [(p: Place): number => p[a]! - centre[0], (p: Place): number => p[b]! - centre[1]];
  const angle = 0.5 * Math.atan2(2 * moment((p) => u(p) * v(p)), moment((p) => u(p) ** 2) - moment((p) => v(p) ** 2));
  let direction: Point = [Math.cos(angle), Math.sin(angle)];
  const distance = (p: Place): number => p[a]! * direction[0] + p[b]! * direction[1];
  const extent = (f: (p: Place) => number): number => Math.max(0, Math.max(...observations.map(f)) - Math.min(...observations.map(f)));
  const [first, last] = [observations[0], observations.at(-1)];
  if (extent(distance) < MIN_HORIZONTAL_EXTENT * extent((p) => p[up]!)) direction = [1, 0];
  else if (first && last && distance(last) < distance(first)) direction = [-direction[0], -direction[1]];
  return places.map((p) => [distance(p), sign * p[up]!]);
}
