// Velocity and acceleration of a filmed body, by finite differences.

import { intervalAt, type Film } from "./film";
import type { Point } from "./types";

/** Velocity at a time, m/s: the difference over the sampling interval that contains it. */
export function velocityAt(film: Film, name: string, time: number): Point | null {
  const track = film.bodies[name];
  if (!track || film.t.length < 2) return null;
  const { i } = intervalAt(film.t, time);
  const dt = film.t[i + 1]! - film.t[i]!;
  return dt > 0 ? [(track.x[i + 1]! - track.x[i]!) / dt, (track.y[i + 1]! - track.y[i]!) / dt] : null;
}

/** Acceleration (net force per mass) at a time, m/s²; `null` where a contact of the body begins within the samples used, since
 * its velocity jumps there. */
export function accelerationAt(film: Film, name: string, time: number): Point | null {
  const track = film.bodies[name];
  const last = film.t.length - 1;
  if (!track || last < 2) return null;
  const { i, share } = intervalAt(film.t, time);
  const k = Math.min(last - 1, Math.max(1, share < 0.5 ? i : i + 1));
  const [before, here, after] = [film.t[k - 1]!, film.t[k]!, film.t[k + 1]!];
  if (film.contacts.some((c) => c.between.includes(name) && c.t >= before - 1e-9 && c.t <= after + 1e-9)) return null;
  const second = (v: readonly number[]): number => {
    const [left, right] = [(v[k]! - v[k - 1]!) / (here - before), (v[k + 1]! - v[k]!) / (after - here)];
    return (2 * (right - left)) / (after - before);
  };
  return [second(track.x), second(track.y)];
}

/** The largest speed, m/s, or acceleration, m/s², of any body at any sample. */
export function largest(film: Film, of: typeof velocityAt): number {
  let most = 0;
  for (const name of Object.keys(film.bodies)) {
    for (const t of film.t) {
      const value = of(film, name, t);
      if (value) most = Math.max(most, Math.hypot(value[0], value[1]));
    }
  }
  return most;
}
