// Choice of a task: a family, one of its tasks by picture, or a scene file.

import { api, ok, type Schema } from "../../api/client";
import { FileError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";
import { picture } from "../../scene/draw";
import type { Box, Scene } from "../../scene/types";
import type { Context } from "../../view";

/** A task to play. */
export interface Task {
  /** `bowling:017`; `custom:NAME` for a scene file. */
  id: string;
  /** Null for a scene file. */
  family: string | null;
  scene: Scene;
  /** Visible box; default: from the scene. */
  box?: Box;
}

/** The task picker; `onChosen` is called with every chosen task. */
export function taskPicker(families: Schema<"FamilyOut">[], onChosen: (task: Task) => void, context: Context): { element: HTMLElement; pick: (id: string) => Promise<void>; name: (text: string) => void } {
  const taskName = h("strong");
  const pick = async (id: string): Promise<void> => {
    const task = await loadTask(id, context.signal);
    put(taskName, id);
    onChosen(task);
  };
  const { button: open, dialog } = gallery(families, (id) => void pick(id).catch(context.fail), context);
  const id = uniqueId("scene");
  const file = h("input", { id, type: "file", accept: ".json,application/json", class: "unseen" });
  const label = h("label", { for: id, class: "button" }, "Open a scene file");
  file.addEventListener("change", () => {
    const one = file.files?.[0];
    if (!one) return;
    context.fail(null);
    readScene(one)
      .then((scene) => (put(taskName, scene.name || one.name), onChosen(customTask(scene))))
      .catch(context.fail);
    file.value = "";
  });
  return { element: h("div", { class: "row" }, taskName, open, h("span", { class: "file" }, file, label), dialog), pick, name: (text) => void put(taskName, text) };
}

/** A scene without a family as a task. */
export function customTask(scene: Scene, box: Box | null = null): Task {
  return { id: `custom:${scene.name || "scene"}`, family: null, scene, ...(box ? { box } : {}) };
}

/** A button that opens the gallery of tasks; `onPicked` gets the id of one. */
export function gallery(families: Schema<"FamilyOut">[], onPicked: (id: string) => void, context: Context): { button: HTMLButtonElement; dialog: HTMLDialogElement } {
  const all = h("div", { class: "gallery" });
  const close = h("button", { type: "button" }, "Close");
  const dialog = h("dialog", { class: "tasks", "aria-label": "Choose a task" }, h("div", { class: "row" }, h("h2", {}, "Choose a task"), close), all);
  close.addEventListener("click", () => dialog.close());
  const button = h("button", { type: "button" }, "Choose a task");
  button.addEventListener("click", () => {
    if (!all.childElementCount) put(all, ...families.flatMap((f) => pictures(f, (id) => (dialog.close(), onPicked(id)), context)));
    dialog.showModal();
  });
  return { button, dialog };
}

/** Reads a task by its id. */
export async function loadTask(id: string, signal: AbortSignal): Promise<Task> {
  const [family = "", number = ""] = id.split(":");
  const path = { family, number: String(Number(number)) };
  const task = await ok(api.GET("/v1/tasks/{family}/{number}", { params: { path }, signal }));
  return { id: task.id, family, scene: task.scene as unknown as Scene };
}

/** Reads a scene file; an error explains the expected format. */
export async function readScene(file: File): Promise<Scene> {
  let scene: unknown;
  try {
    scene = JSON.parse(await file.text());
  } catch (e) {
    throw new FileError(file.name, `it is not JSON (${e instanceof Error ? e.message : e}). A scene file is an iplw.scene/1 document.`);
  }
  const isScene = typeof scene === "object" && scene !== null && (scene as Scene).format === "iplw.scene/1" && Array.isArray((scene as Scene).bodies);
  if (!isScene) throw new FileError(file.name, `it is not a scene: \`format\` must be "iplw.scene/1", with a list of \`bodies\`.`);
  return scene as Scene;
}

/** The tasks of a family, drawn when they become visible. */
function pictures(family: Schema<"FamilyOut">, onPicked: (id: string) => void, context: Context): HTMLElement[] {
  const visibility = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting) continue;
      visibility.unobserve(target);
      const id = (target as HTMLElement).dataset.task!;
      loadTask(id, context.signal)
        .then((task) => put(target.querySelector(".thumb")!, picture(task.scene, "").svg))
        .catch(context.fail);
    }
  });
  const tiles = Array.from({ length: family.tasks }, (_, i) => {
    const id = `${family.name}:${String(i).padStart(3, "0")}`;
    const tile = h("button", { type: "button", class: "tile", "data-task": id }, h("span", { class: "thumb", "aria-hidden": "true" }), id);
    tile.addEventListener("click", () => onPicked(id));
    visibility.observe(tile);
    return tile;
  });
  context.signal.addEventListener("abort", () => visibility.disconnect());
  const heading = h("h3", {}, family.name, h("span", { class: "soft" }, ` ${family.about}`));
  return [heading, set(h("div", { class: "tiles" }, ...tiles), { role: "group", "aria-label": family.name })];
}
