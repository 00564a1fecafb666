// Preview of tracks over their scene, with a summary: of files as they will be read, or of a job's trials.

import { api, ok, type Schema } from "../../api/client";
import { h } from "../../dom";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { short } from "../../parts/slider";
import type { Picture } from "../../scene/draw";
import type { Point, Scene } from "../../scene/types";
import { overlay, dotElements, pathElements } from "./overlay";
import { summarise, type Track } from "./tracks";

/** Draws tracks over a scene; `note` is the caption. */
export function preview(scene: Scene, tracks: readonly Track[], note = ""): { element: HTMLElement; picture: Picture } {
  const elements = [pathElements(tracks.map((t) => t.at), "track"), dotElements(tracks.map((t) => t.at[0]!), "track-start")];
  const launches = new Set(tracks.map((t) => t.trial)).size;
  return overlay(scene, tracks.length ? `${launches} tracks over the scene` : "The scene", tracks.flatMap((t) => t.at), elements, note);
}

/** Summary of tracks, with the expected downward acceleration, m/s^2, if known. */
export function facts(tracks: readonly Track[], gravity: number | null): HTMLElement {
  const summary = summarise(tracks);
  const fall = summary.upwardAcceleration === null || gravity === null ? "" : `${summary.upwardAcceleration < 0 ? "falling" : "rising"} with ${short(Math.abs(summary.upwardAcceleration), "m/s²")}`;
  const bodies = new Set(tracks.map((t) => t.body)).size;
  const words = [
    `${summary.trials} ${summary.trials === 1 ? "trial" : "trials"}${bodies > 1 ? ` of ${bodies} bodies` : ""}, ${summary.samples} samples`,
    `up to ${short(summary.seconds, "s")}`,
    `${short(summary.width, "m")} wide, ${short(summary.height, "m")} high`,
    fall && gravity !== null ? `${fall} (gravity: ${short(gravity)})` : "",
  ];
  return h("p", { class: "glance" }, words.filter(Boolean).join("; "), ".");
}

/** Trials in one page. */
const PAGE = 200;

/** The trials of a diagnosis as the server read them, with their scene. */
export async function submittedTrials(id: string, signal: AbortSignal): Promise<{ scene: Scene; trials: Schema<"DiagnosisTrialOut">[] }> {
  const trials: Schema<"DiagnosisTrialOut">[] = [];
  for (let cursor: string | undefined; ; ) {
    const query = { limit: PAGE, ...(cursor ? { cursor } : {}) };
    const page = await ok(api.GET("/v1/diagnoses/{id}/trials", { params: { path: { id }, query }, signal }));
    trials.push(...page.trials);
    await yieldToBrowser();
    if (!page.next) return { scene: page.scene as unknown as Scene, trials };
    cursor = page.next;
  }
}

/** A picture of the trials of a diagnosis, with a summary. */
export async function submittedTracks(id: string, signal: AbortSignal): Promise<HTMLElement[]> {
  const { scene, trials } = await submittedTrials(id, signal);
  const tracks: Track[] = trials.flatMap(({ trial, t, bodies }) => Object.entries(bodies).map(([body, { x, y }]) => ({ trial, body, ...observations(t, x, y) })));
  const nonEmpty = tracks.filter((track) => track.t.length);
  const [across, up] = scene.gravity ?? [0, -9.81];
  // Each trial starts elsewhere: the bodies are not drawn.
  const withoutBodies = { ...scene, bodies: scene.bodies.map((b) => ({ ...b, position: null })) };
  return [preview(withoutBodies, nonEmpty).element, facts(nonEmpty, scene.bodies.length === 1 && across === 0 ? -up : null)];
}

/** Times and positions at which a body was observed. */
function observations(t: readonly number[], x: readonly (number | null)[], y: readonly (number | null)[]): { t: number[]; at: Point[] } {
  const summary = t.map((_, k) => k).filter((k) => typeof x[k] === "number" && typeof y[k] === "number");
  return { t: summary.map((k) => t[k]!), at: summary.map((k) => [x[k]!, y[k]!]) };
}
