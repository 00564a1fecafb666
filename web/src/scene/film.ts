// Films: states of bodies over time, and the distance between two films.

import type { Point, Pose } from "./types";

export interface FilmTrack {
  /** m */
  x: number[];
  /** m, up */
  y: number[];
  /** rad */
  angle: number[];
}

export interface Contact {
  /** s */
  t: number;
  between: string[];
  /** m/s */
  speed: number;
}

export interface Film {
  /** s, ascending */
  t: number[];
  bodies: Record<string, FilmTrack>;
  /** Empty if unknown: real worlds report no contacts. */
  contacts: Contact[];
}

/** Minimum sampling interval for cubic interpolation, s; below it linear interpolation is used. */
const CUBIC_MIN_STEP_S = 0.05;

/** The last time of a film, s. */
export function filmLength(film: Film): number {
  return film.t.at(-1) ?? 0;
}

/** Poses of bodies at a time; clamped before the start and after the end. */
export function posesAt(film: Film, time: number): Map<string, Pose> {
  const { i, share } = intervalAt(film.t, time);
  const coarse = (film.t[i + 1] ?? 0) - (film.t[i] ?? 0) > CUBIC_MIN_STEP_S;
  const between = (values: number[]): number => (coarse ? monotoneCubic(film.t, values, i, share) : linear(values, i, share));
  return new Map(
    Object.entries(film.bodies).map(([name, b]) => [name, { x: between(b.x), y: between(b.y), angle: linear(b.angle, i, share) }]),
  );
}

/** The path of a body until a time. */
export function pathUntil(film: Film, name: string, until: number): Point[] {
  const track = film.bodies[name];
  if (!track) return [];
  const points: Point[] = [];
  for (let k = 0; k < film.t.length && film.t[k]! <= until; k++) points.push([track.x[k]!, track.y[k]!]);
  const last = posesAt(film, until).get(name);
  if (last) points.push([last.x, last.y]);
  return points;
}

/** Distance of each body between two films, at the times of the second within the first, m. */
export function distanceOverTime(of: Film, from: Film): { t: number[]; bodies: Map<string, number[]> } {
  const t = from.t.filter((time) => time <= filmLength(of) + 1e-9);
  const poses = t.map((time) => posesAt(of, time));
  const bodies = new Map<string, number[]>();
  for (const [name, track] of Object.entries(from.bodies)) {
    if (!of.bodies[name]) continue;
    const distances = t.map((_, k) => {
      const pose = poses[k]!.get(name)!;
      return Math.hypot(pose.x - track.x[k]!, pose.y - track.y[k]!);
    });
    bodies.set(name, distances);
  }
  return { t, bodies };
}

/** The interval that contains a time, and the fraction within it. */
export function intervalAt(t: readonly number[], time: number): { i: number; share: number } {
  if (t.length < 2 || time <= t[0]!) return { i: 0, share: 0 };
  let [low, high] = [0, t.length - 1];
  if (time >= t[high]!) return { i: high - 1, share: 1 };
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle]! <= time) low = middle;
    else high = middle;
  }
  return { i: low, share: (time - t[low]!) / (t[low + 1]! - t[low]!) };
}

function linear(values: readonly number[], i: number, share: number): number {
  const a = values[i] ?? 0;
  return a + share * ((values[i + 1] ?? a) - a);
}

/** Monotone cubic interpolation (Fritsch and Carlson 1980, harmonic mean slopes): it never overshoots the samples, so no ball
 * is drawn below the floor. */
function monotoneCubic(t: readonly number[], values: readonly number[], i: number, share: number): number {
  const slope = (k: number): number => {
    const [a, b, c] = [values[k - 1], values[k]!, values[k + 1]];
    const before = a === undefined ? undefined : (b - a) / (t[k]! - t[k - 1]!);
    const after = c === undefined ? undefined : (c - b) / (t[k + 1]! - t[k]!);
    if (before === undefined || after === undefined) return before ?? after ?? 0;
    return before * after <= 0 ? 0 : (2 * before * after) / (before + after);
  };
  const span = t[i + 1]! - t[i]!;
  const [s1, s2, s3] = [share, share ** 2, share ** 3];
  return (
    (2 * s3 - 3 * s2 + 1) * values[i]! +
    (s3 - 2 * s2 + s1) * span * slope(i) +
    (3 * s2 - 2 * s3) * values[i + 1]! +
    (s3 - s2) * span * slope(i + 1)
  );
}
