// Export of a scene: as a file, and as Python and curl code that is displayed and copied.

import { token } from "../api/token";
import { h, put } from "../dom";
import { pretty } from "../scene/code";
import type { Scene } from "../scene/types";
import type { Context } from "../view";
import { curlCommand, pythonCode } from "./exportCode";
import { copyText, saveFile } from "./share";

export interface ExportPanel {
  buttons: HTMLElement[];
  /** The code, hidden until one of the buttons is pressed. */
  code: HTMLElement;
}

/** A scene to export. */
export interface SceneExport {
  /** Name of its file, without the extension. */
  name: string;
  scene: Scene;
  /** The scene with a start, for code that simulates it. */
  launched: Scene;
}

/** A button that saves the scene, and buttons that display code. */
export function exportPanel({ name: stem, scene, launched }: SceneExport, context: Context): ExportPanel {
  const code = h("div", { class: "stack export-code", hidden: true });
  const languages: [string, string, () => string][] = [
    ["Python", `${stem}.py`, () => pythonCode(launched, location.origin)],
    ["curl", `${stem}.sh`, () => curlCommand(launched, location.origin, token() !== null)],
  ];
  const toggles = languages.map(([name, file, text]) => {
    const toggle = h("button", { type: "button", "aria-expanded": "false" }, name);
    toggle.addEventListener("click", () => {
      const opens = toggle.getAttribute("aria-expanded") === "false";
      for (const other of toggles) other.setAttribute("aria-expanded", String(other === toggle && opens));
      code.hidden = !opens;
      if (opens) put(code, ...codeBlock(name, file, text(), context));
    });
    return toggle;
  });
  const buttons = [
    button("Scene (JSON)", `Save ${stem}.json`, () => saveFile(`${stem}.json`, "application/json", pretty(scene))),
    ...toggles,
  ];
  return { buttons, code };
}

function codeBlock(name: string, file: string, text: string, context: Context): HTMLElement[] {
  const type = "text/plain";
  const copy = button("Copy", `Copy the ${name} code`, () => {
    copyText(text)
      .then(() => (context.say("Copied."), put(copy, "Copied")))
      .catch(context.fail);
  });
  const tools = [copy, button("Save", `Save ${file}`, () => saveFile(file, type, text))];
  return [
    h("p", {}, name === "Python" ? "Simulates the scene with the Python client:" : "Simulates the scene from a shell:"),
    h("pre", { tabindex: 0, "aria-label": `${name} code` }, text),
    h("div", { class: "row" }, ...tools),
  ];
}

function button(text: string, title: string, act: () => void): HTMLElement {
  const element = h("button", { type: "button", title }, text);
  element.addEventListener("click", act);
  return element;
}
