// New, open, save, copy as commands, play. A draft survives a reload of the tab.

import { api, ok } from "../../api/client";
import { FileError, ProblemError } from "../../api/problem";
import { token } from "../../api/token";
import { uniqueId, h } from "../../dom";
import { saveFile } from "../../parts/share";
import { pretty } from "../../scene/code";
import { storeScene } from "../../scene/handoff";
import type { Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { gallery, loadTask, readScene } from "../play/taskPicker";
import { curl, filename, python } from "./export";

const KEY = "iplw-draft";

/** An empty scene. */
export function empty(): Scene {
  return { format: "iplw.scene/1", gravity: [0, -9.8], bodies: [], statics: [] };
}

/** This tab's draft, if any. */
export function storedDraft(): Scene | null {
  const text = sessionStorage.getItem(KEY);
  return text ? (JSON.parse(text) as Scene) : null;
}

export function storeDraft(scene: Scene): void {
  sessionStorage.setItem(KEY, JSON.stringify(scene));
}

/** The buttons; `onOpen` gets a scene to edit, `scene` returns the draft. */
export async function files(
  scene: () => Scene,
  onOpen: (scene: Scene) => void,
  onMessage: (text: string) => void,
  context: Context,
): Promise<{ element: HTMLElement; drop: (file: File) => void }> {
  const { families } = await ok(api.GET("/v1/tasks", { signal: context.signal }));
  const { button: task, dialog } = gallery(families, (id) => void loadTask(id, context.signal).then((one) => onOpen(one.scene)).catch(context.fail), context);
  const openFile = (file: File): void => {
    context.fail(null);
    readScene(file).then((one) => validated(one, file.name, context.signal)).then(onOpen).catch(context.fail);
  };
  const id = uniqueId("file");
  const input = h("input", { id, type: "file", accept: ".json,application/json", class: "unseen" });
  input.addEventListener("change", () => {
    const one = input.files?.[0];
    if (one) openFile(one);
    input.value = "";
  });
  const copy = (what: string, text: () => string): HTMLElement =>
    button(`Copy as ${what}`, () => void copyToClipboard(text(), what).then((done) => onMessage(`${done} ${missingParts(scene())}`)).catch(context.fail));
  const element = h(
    "div",
    { class: "row make-files", role: "group", "aria-label": "File" },
    button("New", () => onOpen(empty())),
    task,
    h("span", { class: "file" }, input, h("label", { for: id, class: "button" }, "Open a scene file")),
    button("Save", () => saveFile(filename(scene()), "application/json", pretty(scene()))),
    copy("curl", () => curl(scene(), location.origin, token() !== null)),
    copy("Python", () => python(scene(), location.origin)),
    button("Play", () => {
      storeScene(scene());
      location.hash = link("play", ["scene"]);
    }, "main"),
    dialog,
  );
  return { element, drop: openFile };
}

/** Checks that the server can read the scene; values that are out of range can be corrected in the editor. */
async function validated(scene: Scene, name: string, signal: AbortSignal): Promise<Scene> {
  try {
    await ok(api.POST("/v1/simulate", { body: { scene: { ...scene, steps: 1 } as unknown as Record<string, never> }, signal }));
  } catch (e) {
    if (!(e instanceof ProblemError)) throw e;
    if (e.problem.status === 400) throw new FileError(name, `it is not a valid scene: ${e.problem.detail}`);
    if (e.problem.status !== 422) throw e;
  }
  return scene;
}

/** Text about parts that are missing for a world. */
function missingParts(scene: Scene): string {
  const missing = [scene.goal ? "" : "a goal", scene.action ? "" : "an action space"].filter(Boolean);
  return missing.length ? `To create a world, add ${missing.join(" and ")}.` : "";
}

/** Copies to the clipboard; if the browser does not allow it (plain HTTP), displays the text for manual copying. */
async function copyToClipboard(text: string, what: string): Promise<string> {
  try {
    await navigator.clipboard.writeText(text);
    return `Copied: a world of this scene, as ${what}.`;
  } catch {
    const close = h("button", { type: "button" }, "Close");
    const area = h("textarea", { rows: 14, readonly: true, "aria-label": `The scene as ${what}` }, text);
    const message = h("p", {}, "The browser does not allow copying: select the text and copy it.");
    const dialog = h("dialog", { class: "copy", "aria-label": `Copy as ${what}` }, message, area, close);
    close.addEventListener("click", () => (dialog.close(), dialog.remove()));
    document.body.append(dialog);
    dialog.showModal();
    area.select();
    return "";
  }
}

function button(title: string, act: () => void, look = ""): HTMLButtonElement {
  const element = h("button", { type: "button", class: look || null }, title);
  element.addEventListener("click", act);
  return element;
}
