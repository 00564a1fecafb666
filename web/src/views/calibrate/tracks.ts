// Measured tracks, possibly with missing bodies or positions.

import type { Schema } from "../../api/client";
import { posesAt, filmLength, type Film } from "../../scene/film";
import type { Point } from "../../scene/types";

type Trial = Schema<"TrialOut">;

/** Observed positions of a body. */
export function observations(trial: Trial, name: string): { t: number; at: Point }[] {
  const track = trial.bodies[name];
  if (!track) return [];
  return trial.t.flatMap((t, k) => {
    const [x, y] = [track.x[k], track.y[k]];
    return typeof x === "number" && typeof y === "number" ? [{ t, at: [x, y] as Point }] : [];
  });
}

/** RMS distance between simulated and observed positions within the simulated time, m; `null` if there is nothing to compare. */
export function rmsDistance(simulated: Film, trial: Trial): number | null {
  let [sum, count] = [0, 0];
  for (const name of Object.keys(trial.bodies)) {
    if (!simulated.bodies[name]) continue;
    for (const observation of observations(trial, name)) {
      if (observation.t > filmLength(simulated) + 1e-9) continue;
      const pose = posesAt(simulated, observation.t).get(name)!;
      sum += (pose.x - observation.at[0]) ** 2 + (pose.y - observation.at[1]) ** 2;
      count += 1;
    }
  }
  return count ? Math.sqrt(sum / count) : null;
}

/** A film of the observed bodies at times when all were observed; `null` if there are fewer than two such times. */
export function filmOfTrial(trial: Trial): Film | null {
  const names = Object.keys(trial.bodies).filter((name) => observations(trial, name).length > 0);
  const all = (k: number): boolean => names.every((n) => typeof trial.bodies[n]!.x[k] === "number" && typeof trial.bodies[n]!.y[k] === "number");
  const complete = trial.t.map((_, k) => k).filter(all);
  if (!names.length || complete.length < 2) return null;
  const of = (values: (number | null)[]): number[] => complete.map((k) => values[k] ?? 0);
  const bodies = names.map((n) => {
    const track = trial.bodies[n]!;
    return [n, { x: of(track.x), y: of(track.y), angle: of(track.angle) }] as const;
  });
  return { t: complete.map((k) => trial.t[k]!), bodies: Object.fromEntries(bodies), contacts: [] };
}
