// The actions of a result: go on in the extended world, export, share.

import type { Schema } from "../../api/client";
import { h } from "../../dom";
import { actionButton, actionGroup, actionGroups } from "../../parts/actionButtons";
import { exportPanel, type SceneExport } from "../../parts/exportPanel";
import { fitLine } from "../../parts/fitQuality";
import { shareButtons } from "../../parts/share";
import { steps } from "../../parts/steps";
import type { Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { diagnoseAgain, extendedScene, openInCalibrate, openInPlan, openInPlay } from "./extendedWorld";
import { fitJudgements } from "./messages";
import type { Report } from "./report";

/** The steps and the actions of a result. */
export function actions(report: Report, job: Schema<"JobOut">, context: Context): HTMLElement {
  const source = (job.config as { job?: string | null }).job ?? null;
  const world = worldButtons(report, job.id, source, context);
  const exports = report.extended_scene ? exportPanel(exported(report, report.extended_scene), context) : null;
  const [worldGroup, exportGroup] = [actionGroup(worldTitle(report), world), exports && actionGroup("Export", exports.buttons)];
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
    actionGroups(world.length ? worldGroup : null, exportGroup, actionGroup("Share", [shareButtons(job, context.signal)])),
    exports?.code,
    h("p", { class: "row soft" }, h("a", { href: link("diagnose") }, "Diagnose other trials"), h("a", { href: link("jobs", [job.id]) }, `Job ${job.id}`)),
  );
}

function exported(report: Report, scene: Scene): SceneExport {
  return { name: "extended_scene", scene, launched: extendedScene(report) ?? scene };
}

function worldTitle(report: Report): string {
  return report.effects.length ? "In the extended world" : "In the fitted scene";
}

function worldButtons(report: Report, id: string, source: string | null, context: Context): HTMLElement[] {
  const scene = extendedScene(report);
  if (!scene) return [];
  const where = worldTitle(report).toLowerCase();
  const again = actionButton("Diagnose again", `Diagnose again with the ${report.effects.length ? "extended" : "fitted"} scene`, "The same trials, with this scene as the base model: is anything still missing?", () => {
    again.disabled = true;
    context.fail(null);
    diagnoseAgain(id, report, context.signal)
      .then((job) => (location.hash = link("diagnose", [job.id])))
      .catch((e: unknown) => ((again.disabled = false), context.fail(e)));
  });
  const next = report.next_scene;
  return [
    actionButton("Play", `Play ${where}`, "Launch bodies by hand, with the effects switched on and off", () => openInPlay(scene, report), true),
    actionButton("Calibrate", `Calibrate ${where}`, "Estimate the latents, now with the effects in the simulation", () => openInCalibrate(report, source)),
    actionButton("Plan", `Plan ${where}`, "Find the actions that are most likely to succeed", () => openInPlan(report)),
    again,
    ...(next ? [actionButton("Play the next experiment", "Play the next experiment", "The launch that would separate the remaining models", () => openInPlay(next, report))] : []),
  ];
}
