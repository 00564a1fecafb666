// Play: place an object, run it, and compare simulation with reality. `#/play/bowling:003` is a task,
// `#/play/bowling:003?action=0.2,0.7,0.5` a task with an action.

import { api, ok } from "../api/client";
import { effectLibrary } from "../api/effects";
import { h, put } from "../dom";
import { storedScene, storedExtent } from "../scene/handoff";
import type { Context, View } from "../view";
import { realWorld } from "./play/realWorld";
import { taskSession, type TaskSession } from "./play/session";
import { customTask, taskPicker, type Task } from "./play/taskPicker";
import "./play.css";

export const play: View = {
  id: "play",
  title: "Play",
  about: "Place an object, run it, and compare simulation with reality.",
  open,
};

async function open(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const [{ families }, library] = await Promise.all([
    ok(api.GET("/v1/tasks", { signal })),
    effectLibrary(signal),
  ]);
  let session: TaskSession | null = null;
  const actionParameter = context.query.get("action");
  const request = actionParameter ? { task: context.rest[0], action: actionParameter.split(",").map(Number) } : null;
  const real = realWorld(() => session?.action() ?? [], (onRan) => session?.onRan(onRan.film, onRan.solved), (id) => void task.pick(id).catch(context.fail), context);
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
  if (first === "scene") task.name(scene ? scene.name || "scene without a name" : "");
  if (scene) show(customTask(scene, storedExtent()));
  else await task.pick(first && first !== "scene" ? first : `${families[0]?.name}:000`);
}
