// Play: place something, let go, and see how far simulation and reality go together. `#/play/bowling:003` is a task,
// `#/play/bowling:003?action=0.2,0.7,0.5` one with an action.

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
  about: "Place something, let go, and see how far simulation and reality go together.",
  open,
};

/** Time between two samples of a simulated film, s: finer than a screen shows. */
const SAMPLE_INTERVAL_S = 1 / 60;

async function open(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const [{ families }, library] = await Promise.all([
    ok(api.GET("/v1/tasks", { signal })),
    all((cursor) => ok(api.GET("/v1/effects", { params: { query: cursor ? { cursor } : {} }, signal })), (page) => page.effects),
  ]);
  let session: TaskSession | null = null;
  const actionParameter = context.query.get("action");
  const asked = actionParameter ? { task: context.rest[0], action: actionParameter.split(",").map(Number) } : null;
  const real = realWorld(() => session?.action() ?? [], (onRan) => session?.onRan(onRan.film, onRan.solved), context);
  const [front, side] = [h("div", { class: "front" }), h("div", { class: "side" })];
  const show = (task: Task): void => {
    context.fail(null);
    session?.close();
    const action = asked?.task === task.id ? asked.action : null;
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

/** One task on the table: its stage, its physics, its films. */
interface TaskSession {
  stage: HTMLElement;
  controls: HTMLElement;
  action: () => number[];
  onRan: (film: Parameters<ReturnType<typeof filmStage>["real"]>[0], solved: boolean | null) => void;
  start: () => Promise<void>;
  close: () => void;
}

function taskSession(task: Task, library: Schema<"EffectOut">[], first: readonly number[] | null, ready: (placeable: boolean) => void, outer: Context): TaskSession {
  // What is under way for a task that was put away is of no use.
  const abort = new AbortController();
  const context: Context = { ...outer, signal: AbortSignal.any([outer.signal, abort.signal]) };
  const subject: SimulationSubject = task.family ? { task: task.id } : { scene: task.scene as unknown as Record<string, never> };
  const shownStage = filmStage(task.scene, `Scene ${task.id}. Arrow keys move what is placed, plus and minus change its size or angle, N takes the next thing.`, context, task.box);
  const asked: { action: number[] | null; latents: Latents; effects: EffectTerm[] } = { action: null, latents: {}, effects: [] };
  const simulate = latest<boolean>(async (fresh) => {
    if (asked.action === null && task.scene.action) return;
    try {
      const answer = await ok(api.POST("/v1/simulate", { body: body(task.scene, subject, asked), signal: context.signal }));
      if (fresh) shownStage.place(asked.action ?? [], answer.reason ?? null);
      placement.showReason(answer.reason ?? null);
      ready(answer.valid);
      shownStage.simulated(answer.valid ? { t: answer.t, bodies: answer.bodies, contacts: answer.contacts } : null, answer.solved ?? null);
      context.fail(null);
    } catch (e) {
      context.fail(e);
    }
  });
  const placement = actionPlacement(task.scene, subject, shownStage.picture, (action) => {
    asked.action = action;
    // What was seen in the real world was of another action.
    shownStage.real(null, null);
    shownStage.place(action, null);
    simulate(true);
  }, context, first);
  const physics = h("div", {});
  const start = async (): Promise<void> => {
    asked.latents = task.family ? await prior(task.family, context.signal) : {};
    put(physics, latents(task.scene, asked.latents, (session) => ((asked.latents = session), simulate(false))));
    simulate(true);
  };
  const effectsForm = effects(library, (terms) => ((asked.effects = terms), simulate(false)));
  const part = (title: string, content: HTMLElement): HTMLElement => h("section", { class: "card", "aria-label": title }, h("h2", {}, title), content);
  return {
    stage: shownStage.element,
    controls: h("div", { class: "stack" }, part("Placing", placement.element), part("Simulated latents", physics), part("Simulated effects", effectsForm)),
    action: placement.action,
    onRan: (film, solved) => {
      shownStage.real(film, solved);
      shownStage.restart();
    },
    start,
    close: () => abort.abort(),
  };
}

function body(scene: Scene, subject: SimulationSubject, asked: { action: number[] | null; latents: Latents; effects: EffectTerm[] }): Schema<"SimulateIn"> {
  const step = scene.time_step ?? 1 / 240;
  return {
    ...subject,
    ...(scene.action && asked.action ? { action: asked.action } : {}),
    latents: asked.latents,
    effects: asked.effects,
    observe_every: Math.max(1, Math.round(SAMPLE_INTERVAL_S / step)),
    stop: false,
  };
}

/** What a family's simulated world takes the latents to be before anything is known. */
async function prior(family: string, signal: AbortSignal): Promise<Latents> {
  const defaults = { density: 1, friction: 0.5, restitution: 0.5 };
  const asked = await api.GET("/v1/worlds/{id}", { params: { path: { id: `${family}-sim` } }, signal });
  const given = asked.data?.latents;
  return { density: given?.density ?? defaults.density, friction: given?.friction ?? defaults.friction, restitution: given?.restitution ?? defaults.restitution };
}
