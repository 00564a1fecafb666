// Tracks over their scene, and what they tell at a glance: of files as they will be read, of a job as they were.

import { api, ok } from "../../api/client";
import { h } from "../../dom";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { short } from "../../parts/slider";
import type { Picture } from "../../scene/draw";
import type { Point, Scene } from "../../scene/types";
import { over, spots, ways } from "./over";
import { glance, type Track } from "./tracks";

/** Draws tracks over a scene; `note` stands under the picture. */
export function sight(scene: Scene, tracks: readonly Track[], note = ""): { element: HTMLElement; picture: Picture } {
  const drawn = [ways(tracks.map((t) => t.at), "track"), spots(tracks.map((t) => t.at[0]!), "track-start")];
  const launches = new Set(tracks.map((t) => t.trial)).size;
  return over(scene, tracks.length ? `${launches} tracks over the scene` : "The scene", tracks.flatMap((t) => t.at), drawn, note);
}

/** What tracks tell at a glance; with the acceleration (m/s^2, downwards) that they should fall with, if it is known. */
export function facts(tracks: readonly Track[], gravity: number | null): HTMLElement {
  const seen = glance(tracks);
  const fall = seen.upwards === null ? "" : `${seen.upwards < 0 ? "falling" : "rising"} with ${short(Math.abs(seen.upwards), "m/s²")}`;
  const bodies = new Set(tracks.map((t) => t.body)).size;
  const words = [
    `${seen.trials} ${seen.trials === 1 ? "launch" : "launches"}${bodies > 1 ? ` of ${bodies} bodies` : ""}, ${seen.samples} samples`,
    `up to ${short(seen.seconds, "s")}`,
    `${short(seen.width, "m")} wide, ${short(seen.height, "m")} high`,
    fall + (fall && gravity !== null ? ` (gravity: ${short(gravity)})` : ""),
  ];
  return h("p", { class: "glance" }, words.filter(Boolean).join("; "), ".");
}

/** Trials asked for at once. */
const PAGE = 200;

/** What a diagnosis was given, as the server read it, drawn. */
export async function given(id: string, signal: AbortSignal): Promise<HTMLElement[]> {
  const tracks: Track[] = [];
  for (let cursor: string | undefined; ; ) {
    const query = { limit: PAGE, ...(cursor ? { cursor } : {}) };
    const page = await ok(api.GET("/v1/diagnoses/{id}/trials", { params: { path: { id }, query }, signal }));
    for (const { trial, t, bodies } of page.trials) {
      for (const [body, { x, y }] of Object.entries(bodies)) tracks.push({ trial, body, ...placed(t, x, y) });
    }
    await yieldToBrowser();
    if (page.next) {
      cursor = page.next;
      continue;
    }
    const scene = page.scene as unknown as Scene;
    const own = tracks.filter((track) => track.t.length);
    const [across, up] = scene.gravity ?? [0, -9.81];
    return [sight(scene, own).element, facts(own, scene.bodies.length === 1 && across === 0 ? -up : null)];
  }
}

/** The times and places at which a body was seen. */
function placed(t: readonly number[], x: readonly (number | null)[], y: readonly (number | null)[]): { t: number[]; at: Point[] } {
  const seen = t.map((_, k) => k).filter((k) => typeof x[k] === "number" && typeof y[k] === "number");
  return { t: seen.map((k) => t[k]!), at: seen.map((k) => [x[k]!, y[k]!]) };
}
