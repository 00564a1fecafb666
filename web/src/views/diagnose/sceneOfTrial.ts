// The extended scene as a trial found it.

import type { Point, Scene } from "../../scene/types";
import { type Report, trajectoryOf } from "./report";
import { trialName } from "./trialName";

type Settings = Record<string, { bodies?: Record<string, object>; statics?: Record<string, object> }>;
type Terms = { name: string; parameters: Record<string, number> }[];

/** The extended scene in the initial state of a trial, in its setting. A setting of one trial has its initial state; otherwise that of
 * the first body is measured. `null` if it is unknown. */
export function sceneOfTrial(report: Report, trial: number): Scene | null {
  const scene = report.extended_scene;
  if (!scene?.bodies.length) return null;
  const launch = report.launches.find((l) => l.trial === trial);
  const { settings, ...plain } = scene;
  const override = launch?.setting ? (settings as Settings | undefined)?.[launch.setting] : undefined;
  const isOwnSetting = override !== undefined && launch?.setting === launch?.name;
  const start = isOwnSetting ? {} : measuredStart(report, trial);
  if (!start) return null;
  const set = <T extends { name: string }>(object: T, by: Record<string, object> | undefined): T => ({ ...object, ...by?.[object.name] });
  const [first, ...others] = scene.bodies.map((b) => set(b, override?.bodies));
  const effects = (scene.effects as Terms | undefined)?.map((e) => ({ ...e, parameters: { ...e.parameters, ...parametersOfSetting(report, e.name, launch?.setting ?? null) } }));
  return {
    ...plain,
    name: `${scene.name || "scene"}, extended${launch?.name ? `, ${trialName(launch.name)}` : ""}`,
    bodies: [{ ...first!, ...start }, ...others],
    ...(scene.statics ? { statics: scene.statics.map((b) => set(b, override?.statics)) } : {}),
    ...(effects ? { effects } : {}),
  };
}

/** Position and velocity of the first body from the parabola through the first three positions of the extended model. */
function measuredStart(report: Report, trial: number): { position: Point; velocity: Point } | null {
  const table = trajectoryOf(report.paths, trial);
  if (!table) return null;
  const last = Math.min(3, table.starts[0] ?? table.t.length);
  const [t, at] = [table.t.slice(0, last), table.after.at.slice(0, last)];
  if (t.length < 2 || !at.flat().every(Number.isFinite)) return null;
  const velocity = (k: 0 | 1): number => {
    const slope = (i: number): number => (at[i + 1]![k] - at[i]![k]) / (t[i + 1]! - t[i]!);
    if (t.length < 3) return slope(0);
    return slope(0) - ((slope(1) - slope(0)) * (t[1]! - t[0]!)) / (t[2]! - t[0]!);
  };
  return { position: at[0]!, velocity: [velocity(0), velocity(1)] };
}

/** Parameters of an effect that are specific to a setting. */
function parametersOfSetting(report: Report, effect: string, setting: string | null): Record<string, number> {
  const parameters = report.effects.find((e) => e.name === effect)?.parameters.filter((p) => p.setting !== null && p.setting === setting) ?? [];
  return Object.fromEntries(parameters.map((p) => [p.name, p.value]));
}
