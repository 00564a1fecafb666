// Play: place an object, run it, and compare simulation with reality. `#/play/bowling:003` is a task,
// `#/play/bowling:003?action=0.2,0.7,0.5` a task with an action.

import { all, api, ok, type Schema } from "../api/client";
import { h, put } from "../dom";
import { latest } from "../parts/latest";
import { storedScene, storedExtent } from "../scene/handoff";
import type { Scene } from "../scene/types";
import type { Context, View } from "../view";
import { effects, latents, type Latents, type EffectTerm } from "./play/physics";
import { actionPlacement, type SimulationSubject } from "./play/placement";
import { realWorld } from "./play/realWorld";
import { filmStage } from "./play/stage";
import { taskPicker, type Task } from "./play/taskPicker";
import "./play.css";

export const play: View = {
  id: "play",
  title: "Play",
  about: "Place an object, run it, and compare simulation with reality.",
  open,
};

/** Time between two samples of a simulated film, s; below the frame time of a screen. */
const SAMPLE_INTERVAL_S = 1 / 60;

async function open(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const [{ families }, library] = await Promise.all([
    ok(api.GET("/v1/tasks", { signal })),
    all((cursor) => ok(api.GET("/v1/effects", { params: { query: cursor ? { cursor } : {} }, signal })), (page) => page.effects),
  ]);
  let session: TaskSession | null = null;
  const actionParameter = context.query.get("action");
  const request = actionParameter ? { task: context.rest[0], action: actionParameter.split(",").map(Number) } : null;
  const real = realWorld(() => session?.action() ?? [], (onRan) => session?.onRan(onRan.film, onRan.solved), context);
  const [front, side] = [h("div", { class: "front" }), h("div", { class: "side" })];
  const show = (task: Task): void => {
    context.fail(null);
    session?.close();
    const action = request?.task === task.id ? request.action : null;
    session = taskSession(task, library, action, (placeable) => real.ready(placeable), context);
    put(front, session.stage);
    put(side, session.controls);
    session.start().catch(context.fail);
    real.about(task).catch(context.fail);
  };
  const task = taskPicker(families, show, context);
  put(place, h("div", { class: "play-head" }, h("div", { class: "card" }, task.element), real.element), h("div", { class: "play-body" }, front, side));
  const [first] = context.rest;
  const scene = first === "scene" ? storedScene() : null;
  const box = storedExtent();
  if (scene) show({ id: `custom:${scene.name || "scene"}`, family: null, scene, ...(box ? { box } : {}) });
  else await task.pick(first && first !== "scene" ? first : `${families[0]?.name}:000`);
}

/** An open task: its stage, physics and films. */
interface TaskSession {
  stage: HTMLElement;
  controls: HTMLElement;
  action: () => number[];
  onRan: (film: Parameters<ReturnType<typeof filmStage>["real"]>[0], solved: boolean | null) => void;
  start: () => Promise<void>;
  close: () => void;
}

function taskSession(task: Task, library: Schema<"EffectOut">[], first: readonly number[] | null, ready: (placeable: boolean) => void, outer: Context): TaskSession {
  // Requests of a closed task are aborted.
  const abort = new AbortController();
  const context: Context = { ...outer, signal: AbortSignal.any([outer.signal, abort.signal]) };
  const subject: SimulationSubject = task.family ? { task: task.id } : { scene: task.scene as unknown as Record<string, never> };
  const visibleStage = filmStage(task.scene, `Scene ${task.id}. Arrow keys move the object, plus and minus change its size or angle, N selects the next object.`, context, task.box);
  const request: { action: number[] | null; latents: Latents; effects: EffectTerm[] } = { action: null, latents: {}, effects: [] };
  const simulate = latest<boolean>(async (fresh) => {
    if (request.action === null && task.scene.action) return;
    try {
      const answer = await ok(api.POST("/v1/simulate", { body: body(task.scene, subject, request), signal: context.signal }));
      if (fresh) visibleStage.place(request.action ?? [], answer.reason ?? null);
      placement.showReason(answer.reason ?? null);
      ready(answer.valid);
      visibleStage.simulated(answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: answer.contacts } : null, answer.solved ?? null);
      context.fail(null);
    } catch (e) {
      context.fail(e);
    }
  });
  const placement = actionPlacement(task.scene, subject, visibleStage.picture, (action) => {
    request.action = action;
    // The real film belongs to the previous action.
    visibleStage.real(null, null);
    visibleStage.place(action, null);
    simulate(true);
  }, context, first);
  const physics = h("div", {});
  const start = async (): Promise<void> => {
    request.latents = task.family ? await prior(task.family, context.signal) : {};
    put(physics, latents(task.scene, request.latents, (session) => ((request.latents = session), simulate(false))));
    simulate(true);
  };
  const effectsForm = effects(library, (terms) => ((request.effects = terms), simulate(false)));
  const part = (title: string, content: HTMLElement): HTMLElement => h("section", { class: "card", "aria-label": title }, h("h2", {}, title), content);
  return {
    stage: visibleStage.element,
    controls: h("div", { class: "stack" }, part("Action", placement.element), part("Simulated latents", physics), part("Simulated effects", effectsForm)),
    action: placement.action,
    onRan: (film, solved) => {
      visibleStage.real(film, solved);
      visibleStage.restart();
    },
    start,
    close: () => abort.abort(),
  };
}

function body(scene: Scene, subject: SimulationSubject, request: { action: number[] | null; latents: Latents; effects: EffectTerm[] }): Schema<"SimulateIn"> {
  const step = scene.time_step ?? 1 / 240;
  return {
    ...subject,
    ...(scene.action && request.action ? { action: request.action } : {}),
    latents: request.latents,
    effects: request.effects,
    observe_every: Math.max(1, Math.round(SAMPLE_INTERVAL_S / step)),
    stop: false,
  };
}

/** Prior means of the latents, from the family's simulated world. */
async function prior(family: string, signal: AbortSignal): Promise<Latents> {
  const defaults = { density: 1, friction: 0.5, restitution: 0.5 };
  const request = await api.GET("/v1/worlds/{id}", { params: { path: { id: `${family}-sim` } }, signal });
  const parsedAction = request.data?.latents;
  return { density: parsedAction?.density ?? defaults.density, friction: parsedAction?.friction ?? defaults.friction, restitution: parsedAction?.restitution ?? defaults.restitution };
}
