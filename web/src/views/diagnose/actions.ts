// What to do with a result: go on in the extended world, export, share.

import { reportHtml } from "../../parts/reportView";
import { fitLine } from "../../parts/fitQuality";
import { steps } from "../../parts/steps";
import { h, put } from "../../dom";
import { type Context, link } from "../../view";
import { exportPanel } from "./exportPanel";
import { diagnoseAgain, extendedScene, openInCalibrate, openInPlan, openInPlay } from "./extendedWorld";
import { fitJudgements } from "./messages";
import type { Report } from "./report";
import { copyButton, saveFile } from "./saveFile";
import type { Schema } from "../../api/client";

/** The steps and the actions of a result. */
export function actions(report: Report, job: Schema<"JobOut">, context: Context): HTMLElement {
  const source = (job.config as { job?: string | null }).job ?? null;
  const world = worldButtons(report, job.id, source, context);
  const exports = report.extended_scene ? exportPanel(report, report.extended_scene, context) : null;
  const [worldGroup, exportGroup] = [group(worldTitle(report), world), exports && group("Export", exports.buttons)];
  const focusFirst = (of: HTMLElement | null) => (): void => {
    of?.scrollIntoView({ block: "center" });
    of?.querySelector("button")?.focus();
  };
  return h(
    "section",
    { class: "card stack result-actions", "aria-label": "Next steps" },
    steps("diagnose", {
      calibrate: link("calibrate", source ? [source] : []),
      ...(world.length ? { extended: focusFirst(worldGroup) } : {}),
      ...(exportGroup ? { export: focusFirst(exportGroup) } : {}),
    }),
    h("div", { class: "stack fit-lines" }, ...fitJudgements(report).map(fitLine)),
    h("div", { class: "action-groups" }, world.length ? worldGroup : null, exportGroup, group("Share", shareButtons(job.id, context))),
    exports?.code,
    h("p", { class: "row soft" }, h("a", { href: link("diagnose") }, "Diagnose other trials"), h("a", { href: link("jobs", [job.id]) }, `Job ${job.id}`)),
  );
}

function worldTitle(report: Report): string {
  return report.effects.length ? "In the extended world" : "In the fitted scene";
}

function worldButtons(report: Report, id: string, source: string | null, context: Context): HTMLElement[] {
  const scene = extendedScene(report);
  if (!scene) return [];
  const where = worldTitle(report).toLowerCase();
  const again = button("Diagnose again", `Diagnose again with the ${report.effects.length ? "extended" : "fitted"} scene`, "The same trials, with this scene as the base model: is anything still missing?", () => {
    again.disabled = true;
    context.fail(null);
    diagnoseAgain(id, report, context.signal)
      .then((job) => (location.hash = link("diagnose", [job.id])))
      .catch((e: unknown) => ((again.disabled = false), context.fail(e)));
  });
  const next = report.next_scene;
  return [
    button("Play", `Play ${where}`, "Launch bodies by hand, with the effects switched on and off", () => openInPlay(scene, report), true),
    button("Calibrate", `Calibrate ${where}`, "Estimate the latents, now with the effects in the simulation", () => openInCalibrate(report, source)),
    button("Plan", `Plan ${where}`, "Find the actions that are most likely to succeed", () => openInPlan(report)),
    again,
    ...(next ? [button("Play the next experiment", "Play the next experiment", "The launch that would separate the remaining models", () => openInPlay(next, report))] : []),
  ];
}

function shareButtons(id: string, context: Context): HTMLElement[] {
  const save = button("Save the report (HTML)", "Save the report (HTML)", "One file that opens without a server", () => {
    reportHtml(id, context.signal)
      .then((html) => saveFile(`${id}-report.html`, "text/html", html))
      .catch(context.fail);
  });
  return [copyButton("Copy the link", () => location.href, context.say, context.fail), save];
}

function group(name: string, buttons: readonly HTMLElement[]): HTMLElement {
  return h("div", { class: "action-group", role: "group", "aria-label": name }, h("h3", {}, name), h("div", { class: "row" }, ...buttons));
}

function button(text: string, label: string, title: string, act: () => void, main = false): HTMLButtonElement {
  const element = h("button", { type: "button", class: main ? "main" : null, "aria-label": label === text ? null : label, title });
  put(element, text);
  element.addEventListener("click", act);
  return element;
}
