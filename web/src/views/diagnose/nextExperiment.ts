// The next experiment: text, and the trajectories that each rival model predicts.

import { api, ok } from "../../api/client";
import { h, put } from "../../dom";
import { filmLength, type Film, pathUntil } from "../../scene/film";
import type { Point, Scene } from "../../scene/types";
import type { Context } from "../../view";
import { arrows, overlay, dotElements, pathElements } from "./overlay";
import type { Report, Score } from "./report";
import { plain, effectSetName } from "./messages";

/** Maximum number of rivals displayed. */
const MAX_RIVALS = 4;
/** Time between samples, s. */
const SAMPLE_INTERVAL_S = 1 / 60;

export function nextExperiment(report: Report, context: Context): HTMLElement[] {
  const { next_experiment: experiment, next_scene: scene } = report;
  if (!experiment) return [];
  const words = [h("p", {}, h("strong", {}, plain(experiment.do))), h("p", {}, `Why: ${plain(experiment.why)}`)];
  if (!scene) return words;
  const place = h("div", { class: "stack" }, h("p", { class: "soft" }, "Simulating the rival models…"));
  drawPredictions(report, scene, place, context).catch((e: unknown) => {
    put(place);
    context.fail(e);
  });
  return [...words, place];
}

/** The models of the credible set with estimates, best first. */
export function rivals(report: Report): Score[] {
  const credibleSet = new Set(report.rivals.map((r) => JSON.stringify(r)));
  return report.scores.filter((s) => credibleSet.has(JSON.stringify(s.effects))).slice(0, MAX_RIVALS);
}

async function drawPredictions(report: Report, scene: Scene, place: HTMLElement, context: Context): Promise<void> {
  const body = scene.bodies[0];
  const start = body?.position;
  if (!body || !start) return void put(place);
  const sets = rivals(report);
  const films = await Promise.all(sets.map((s) => film(scene, s, context.signal)));
  const paths = films.map((f) => (f ? pathUntil(f, body.name, filmLength(f)) : []));
  const velocity = body.velocity ?? [0, 0];
  const all: Point[] = [start, ...paths.flat()];
  const span = Math.max(...all.map((p) => Math.hypot(p[0] - start[0], p[1] - start[1])), 0.1);
  const scale = (0.2 * span) / (Math.hypot(...velocity) || 1);
  const elements = [...paths.map((c, i) => pathElements([c], `track rival rival-${i}`)), arrows([{ at: start, push: velocity }], scale, "arrow launch"), dotElements([start], "seen-spot")];
  const keys = sets.map((s, i) => h("span", { class: `key swatch rival rival-${i}` }, `by ${effectSetName(s.effects)}`));
  const label = `The next experiment: throw from ${start.map((v) => v.toFixed(2)).join(", ")} m with ${velocity.map((v) => v.toFixed(2)).join(", ")} m/s`;
  put(place, h("div", { class: "row keys" }, ...keys), overlay(scene, label, all, elements, `${label}.`).element);
}

/** The experiment simulated with one rival model; `null` if it is not valid. */
async function film(scene: Scene, rival: Score, signal: AbortSignal): Promise<Film | null> {
  const effects = rival.sizes.map((e) => ({ name: e.name, parameters: Object.fromEntries(e.parameters.map((p) => [p.name, p.value])) }));
  const every = Math.max(1, Math.round(SAMPLE_INTERVAL_S / (scene.time_step ?? 1 / 240)));
  const body = { scene: scene as unknown as Record<string, never>, effects, observe_every: every, stop: false };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  return answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: [] } : null;
}
