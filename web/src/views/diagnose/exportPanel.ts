// Export of the extended scene: as a file, and as Python and curl code that is displayed and copied.

import { token } from "../../api/token";
import { h, put } from "../../dom";
import type { Context } from "../../view";
import { pretty } from "../make/export";
import { curlCommand, pythonCode } from "./exportCode";
import type { Scene } from "../../scene/types";
import { extendedScene } from "./extendedWorld";
import { plainReport, type Report } from "./report";
import { copyButton, saveFile } from "./saveFile";

export interface ExportPanel {
  buttons: HTMLElement[];
  /** The code, hidden until one of the buttons is pressed. */
  code: HTMLElement;
}

/** Buttons that save the scene and the report's data, and buttons that display code. */
export function exportPanel(report: Report, scene: Scene, context: Context): ExportPanel {
  const code = h("div", { class: "stack export-code", hidden: true });
  const launched = extendedScene(report) ?? scene;
  const languages: [string, string, () => string][] = [
    ["Python", "extended_scene.py", () => pythonCode(launched, location.origin)],
    ["curl", "extended_scene.sh", () => curlCommand(launched, location.origin, token() !== null)],
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
    button("Scene (JSON)", "Save the extended scene", () => saveFile("extended_scene.json", "application/json", pretty(scene))),
    ...toggles,
    button("Data (JSON)", "Save the data of the report", () => saveFile("report.json", "application/json", `${JSON.stringify(plainReport(report), null, 2)}\n`)),
  ];
  return { buttons, code };
}

function codeBlock(name: string, file: string, text: string, context: Context): HTMLElement[] {
  const type = "text/plain";
  const tools = [copyButton("Copy", () => text, context.say, context.fail), button("Save", `Save ${file}`, () => saveFile(file, type, text))];
  return [
    h("p", {}, name === "Python" ? "Simulates the extended scene with the Python client:" : "Simulates the extended scene from a shell:"),
    h("pre", { tabindex: 0, "aria-label": `${name} code` }, text),
    h("div", { class: "row" }, ...tools),
  ];
}

function button(text: string, title: string, act: () => void): HTMLElement {
  const element = h("button", { type: "button", title }, text);
  element.addEventListener("click", act);
  return element;
}
