// Which task: a family, one of its tasks by picture, or a scene file.

import { api, ok, type Schema } from "../../api/client";
import { FileError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";
import { picture } from "../../scene/draw";
import type { Box, Scene } from "../../scene/types";
import type { Context } from "../../view";

/** What is played with. */
export interface Task {
  /** `bowling:017`; of a scene file `custom:NAME`. */
  id: string;
  /** Absent for a scene file. */
  family: string | null;
  scene: Scene;
  /** What is to be in sight; absent where the scene tells. */
  box?: Box;
}

/** The choice of a task; `chosen` is called with every task that is picked. */
export function taskPicker(families: Schema<"FamilyOut">[], onChosen: (task: Task) => void, context: Context): { element: HTMLElement; pick: (id: string) => Promise<void> } {
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
      .then((scene) => (put(taskName, scene.name || one.name), onChosen({ id: `custom:${scene.name || "scene"}`, family: null, scene })))
      .catch(context.fail);
    file.value = "";
  });
  return { element: h("div", { class: "row" }, taskName, open, h("span", { class: "file" }, file, label), dialog), pick };
}

/** A button that opens the pictures of all tasks; `picked` is told the id of one. */
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

/** A task of the server's by its id. */
export async function loadTask(id: string, signal: AbortSignal): Promise<Task> {
  const [family = "", number = ""] = id.split(":");
  const path = { family, number: String(Number(number)) };
  const task = await ok(api.GET("/v1/tasks/{family}/{number}", { params: { path }, signal }));
  return { id: task.id, family, scene: task.scene as unknown as Scene };
}

/** A scene of a file, as far as a page can tell; else an error that says what a scene file is. */
export async function readScene(file: File): Promise<Scene> {
  let scene: unknown;
  try {
    scene = JSON.parse(await file.text());
  } catch (e) {
    throw new FileError(file.name, `it is not JSON (${e instanceof Error ? e.message : e}). A scene file is an iplw.scene/1 document.`);
  }
  const isScene = typeof scene === "object" && scene !== null && (scene as Scene).format === "iplw.scene/1" && Array.isArray((scene as Scene).bodies);
  if (!isScene) throw new FileError(file.name, `it is no scene: \`format\` must be "iplw.scene/1", with a list of \`bodies\`.`);
  return scene as Scene;
}

/** A family's tasks, drawn when they come into sight. */
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
