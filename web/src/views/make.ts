// Make: draw a scene that is simulated while you draw.

import { effectLibrary } from "../api/effects";
import { h, put } from "../dom";
import { type Context, link, type View } from "../view";
import { files } from "./make/files";
import { sceneEditor } from "./make/editor";
import { loadTask } from "./play/taskPicker";
import "./make.css";

export const make: View = {
  id: "make",
  title: "Make",
  about: "Draw a scene, watch its simulation while you draw, create a world from it.",
  open,
};

/** `#/make` opens this tab's draft, `#/make?task=bowling:017` a task. */
async function open(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const task = context.query.get("task");
  const [first, library] = await Promise.all([
    task ? loadTask(task, signal).then((loaded) => loaded.scene) : null,
    effectLibrary(signal),
  ]);
  // A reload must restore the draft instead of opening the task again.
  if (task) history.replaceState(null, "", link("make"));
  const editor = sceneEditor(first, library, context);
  const status = h("p", { class: "soft make-said", role: "status" });
  const { element, drop } = await files(editor.scene, editor.open, (text) => put(status, text), context);
  put(place, h("div", { class: "card stack" }, element, status), editor.element);
  onFileDrop(place, drop, signal);
  editor.start();
}

/** Handles files dropped anywhere in the view. */
function onFileDrop(place: HTMLElement, drop: (file: File) => void, signal: AbortSignal): void {
  place.addEventListener("dragover", (event) => event.preventDefault(), { signal });
  place.addEventListener("drop", (event) => {
    event.preventDefault();
    const file = event.dataTransfer?.files[0];
    if (file) drop(file);
  }, { signal });
}
