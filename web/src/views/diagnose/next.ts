// The next experiment in words, and drawn over the scene: where it starts and which way each rival has it go.

import { api, ok } from "../../api/client";
import { h, put } from "../../dom";
import { filmLength, type Film, pathUntil } from "../../scene/film";
import type { Point, Scene } from "../../scene/types";
import type { Context } from "../../view";
import { arrows, over, spots, ways } from "./over";
import type { Report, Score } from "./report";
import { plain, set } from "./words";

/** Most rivals that are drawn. */
const MOST = 4;
/** Seconds between samples. */
const SAMPLES = 1 / 60;

export function next(found: Report, context: Context): HTMLElement[] {
  const { next_experiment: said, next_scene: scene } = found;
  if (!said) return [];
  const words = [h("p", {}, h("strong", {}, plain(said.do))), h("p", {}, `Why: ${plain(said.why)}`)];
  if (!scene) return words;
  const place = h("div", { class: "stack" }, h("p", { class: "soft" }, "Simulating what each rival has it do…"));
  drawn(found, scene, place, context).catch((e: unknown) => {
    put(place);
    context.fail(e);
  });
  return [...words, place];
}

/** The rivals that have sizes, the best first. */
export function rivals(found: Report): Score[] {
  const tied = new Set(found.rivals.map((r) => JSON.stringify(r)));
  return found.scores.filter((s) => tied.has(JSON.stringify(s.effects))).slice(0, MOST);
}

async function drawn(found: Report, scene: Scene, place: HTMLElement, context: Context): Promise<void> {
  const body = scene.bodies[0];
  const start = body?.position;
  if (!body || !start) return void put(place);
  const sets = rivals(found);
  const films = await Promise.all(sets.map((s) => film(scene, s, context.signal)));
  const courses = films.map((f) => (f ? pathUntil(f, body.name, filmLength(f)) : []));
  const velocity = body.velocity ?? [0, 0];
  const all: Point[] = [start, ...courses.flat()];
  const span = Math.max(...all.map((p) => Math.hypot(p[0] - start[0], p[1] - start[1])), 0.1);
  const per = (0.2 * span) / (Math.hypot(...velocity) || 1);
  const drawn = [...courses.map((c, i) => ways([c], `track rival rival-${i}`)), arrows([{ at: start, push: velocity }], per, "arrow launch"), spots([start], "seen-spot")];
  const keys = sets.map((s, i) => h("span", { class: `key swatch rival rival-${i}` }, `by ${set(s.effects)}`));
  const label = `The next experiment: launched from ${start.map((v) => v.toFixed(2)).join(", ")} m with ${velocity.map((v) => v.toFixed(2)).join(", ")} m/s`;
  put(place, h("div", { class: "row keys" }, ...keys), over(scene, label, all, drawn, `${label}.`).element);
}

/** The experiment as one rival would have it seen; `null` where it has no sizes for this setting. */
async function film(scene: Scene, rival: Score, signal: AbortSignal): Promise<Film | null> {
  const effects = rival.sizes.map((e) => ({ name: e.name, parameters: Object.fromEntries(e.parameters.map((p) => [p.name, p.value])) }));
  const every = Math.max(1, Math.round(SAMPLES / (scene.time_step ?? 1 / 240)));
  const body = { scene: scene as unknown as Record<string, never>, effects, observe_every: every, stop: false };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  return answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: [] } : null;
}
