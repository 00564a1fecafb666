// The extended scene as a world to go on with: played, calibrated, planned in, or diagnosed again.

import { api, ok, type Schema } from "../../api/client";
import { storeScene } from "../../scene/handoff";
import type { Box, Component, Scene } from "../../scene/types";
import { link } from "../../view";
import { submittedTrials } from "./preview";
import { extentOfTrials, type Report, trialsByDistance } from "./report";
import { sceneOfTrial } from "./sceneOfTrial";
import { trialsCsv } from "./trialsCsv";

/** Margin on both sides of the range of measured launch velocities, as a share of it, and its minimum, m/s. */
const VELOCITY_MARGIN = 0.1;
const MIN_VELOCITY_MARGIN = 0.25;

/** The extended scene with the start of the trial of median deviation; without one, as reported. */
export function extendedScene(report: Report): Scene | null {
  const order = trialsByDistance(report);
  const scene = sceneOfTrial(report, order[order.length >> 1] ?? 0) ?? report.extended_scene;
  return scene ? { ...scene, name: `${report.extended_scene?.name || "scene"}, extended` } : null;
}

/** Opens a scene in Play. */
export function openInPlay(scene: Scene, report: Report): void {
  storeScene(scene, visibleBox(scene, report));
  location.hash = link("play", ["scene"]);
}

/** Opens the extended scene of a trial in Play, exactly as the trial: without an action space. */
export function playTrial(report: Report, trial: number): void {
  const scene = sceneOfTrial(report, trial);
  if (!scene) return;
  const { action: _space, ...launched } = scene;
  openInPlay(launched, report);
}

/** The box of the trials for scenes without objects of their own extent; `null`: that of the scene. */
function visibleBox(scene: Scene, report: Report): Box | null {
  return (scene.statics ?? []).some((s) => s.shape.type !== "halfspace") ? null : extentOfTrials(report);
}

/** Opens the extended scene in Plan. */
export function openInPlan(report: Report): void {
  const scene = extendedScene(report);
  if (!scene) return;
  storeScene(withActionSpace(scene, report), visibleBox(scene, report));
  const task = taskOf(report);
  location.hash = link("plan", ["scene"], task ? { task } : {});
}

/** The task of the first trial, if the trials are those of an estimation: `bowling:017` of `bowling:017/3`. */
export function taskOf(report: Report): string | null {
  return /^([a-z_]+:\d{3})\/\d+$/.exec(report.launches[0]?.name ?? "")?.[1] ?? null;
}

/** Opens Calibrate: the estimation that measured the trials, with the effects fitted as well, or the extended scene. */
export function openInCalibrate(report: Report, estimation: string | null): void {
  const parameters = report.effects.flatMap((e) => e.parameters.map((p) => `${e.name}.${p.name}`));
  if (estimation) return void (location.hash = link("calibrate", [], { like: estimation, fit: [...new Set(parameters)].join(",") }));
  const scene = extendedScene(report);
  if (!scene) return;
  storeScene(withActionSpace(scene, report));
  location.hash = link("calibrate", [], { scene: "handoff" });
}

/** Starts a diagnosis of the same trials with the extended scene as the base model. */
export async function diagnoseAgain(id: string, report: Report, signal: AbortSignal): Promise<Schema<"JobOut">> {
  const { trials } = await submittedTrials(id, signal);
  const body = { scene: report.extended_scene as unknown as Record<string, never>, trials: trialsCsv(trials) };
  return ok(api.POST("/v1/diagnoses", { body, signal }));
}

/** The scene with an action space: its own, or the launch velocities of the first body within the measured range. */
export function withActionSpace(scene: Scene, report: Report): Scene {
  const body = scene.bodies[0];
  if (scene.action || !body) return scene;
  const velocities = report.launches.map((l) => sceneOfTrial(report, l.trial)?.bodies[0]?.velocity).filter((v) => v !== undefined);
  const component = (set: "vx" | "vy", k: 0 | 1): Component => {
    const values = velocities.length ? velocities.map((v) => v[k]) : [body.velocity?.[k] ?? 0];
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const margin = Math.max(MIN_VELOCITY_MARGIN, VELOCITY_MARGIN * (high - low));
    return { target: body.name, set, low: rounded(low - margin), high: rounded(high + margin) };
  };
  return { ...scene, action: { components: [component("vx", 0), component("vy", 1)], bounds: extentOfTrials(report) } };
}

function rounded(v: number): number {
  return Number(v.toFixed(3));
}
