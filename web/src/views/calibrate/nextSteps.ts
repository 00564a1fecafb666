// After an estimation: how well it fits, and what to do next.

import { api, ok } from "../../api/client";
import { hasEnded } from "../../api/jobState";
import { h, put } from "../../dom";
import { actionButton, actionGroup, actionGroups } from "../../parts/actionButtons";
import { exportPanel } from "../../parts/exportPanel";
import { fitLine } from "../../parts/fitQuality";
import { shareButtons } from "../../parts/share";
import { steps } from "../../parts/steps";
import { storeScene } from "../../scene/handoff";
import type { Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { calibratedScene, type CalibratedWorld } from "./calibratedWorld";
import { type EstimationState, requestOf, sceneOfRequest } from "./estimation";
import { judgement } from "./judgement";

export interface NextSteps {
  element: HTMLElement;
  show: (now: EstimationState) => void;
}

/** Hidden until the estimation has ended with measured trials. */
export function nextSteps(id: string, context: Context): NextSteps {
  const element = h("section", { class: "card stack next-steps", hidden: true, "aria-label": "Next steps" });
  const show = (now: EstimationState): void => {
    element.hidden = !hasEnded(now.job) || now.interactions === 0;
    if (!element.hidden) fill(element, id, now, context).catch(context.fail);
  };
  return { element, show };
}

async function fill(element: HTMLElement, id: string, now: EstimationState, context: Context): Promise<void> {
  const fit = judgement(now);
  const isBad = fit.level === "bad" || fit.level === "warn";
  const start = (): void => void startDiagnosis(id, diagnose, context);
  const diagnose = actionButton("Diagnose these trials", "Diagnose these trials", "Find the effects that the simulation lacks", start, isBad);
  const world = await calibratedScene(now, context.signal);
  const exports = world && exportPanel({ name: "calibrated_scene", scene: world.scene, launched: world.launched }, context);
  const play = (scene: Scene) => (): void => {
    storeScene(scene);
    location.hash = link("play", ["scene"]);
  };
  const plan = ({ task, scene }: CalibratedWorld) => (): void => {
    storeScene(scene);
    location.hash = sceneOfRequest(requestOf(now.job)) ? link("plan", ["scene"]) : link("plan", [], { task, estimation: id });
  };
  const where = requestOf(now.job).fit?.length ? "In the extended world" : "In the calibrated world";
  const button = (text: string, help: string, act: () => void): HTMLElement => actionButton(text, `${text} ${where.toLowerCase()}`, help, act, text === "Play" && !isBad);
  const worldGroup = world && actionGroup(where, [button("Play", "Launch bodies by hand, with the estimates", play(world.scene)), button("Plan", "Find the actions that are most likely to succeed", plan(world))]);
  const exportGroup = exports && actionGroup("Export", exports.buttons);
  const focusFirst = (of: HTMLElement) => (): void => of.querySelector("button")?.focus();
  put(
    element,
    steps("calibrate", { diagnose: start, ...(worldGroup && !isBad ? { extended: focusFirst(worldGroup) } : {}), ...(exportGroup && !isBad ? { export: focusFirst(exportGroup) } : {}) }),
    fitLine(fit),
    actionGroups(actionGroup("Find what is missing", [diagnose]), worldGroup, exportGroup, actionGroup("Share", [shareButtons(now.job, context.signal)])),
    exports?.code,
  );
}

async function startDiagnosis(id: string, button: HTMLButtonElement, context: Context): Promise<void> {
  button.disabled = true;
  context.fail(null);
  try {
    const job = await ok(api.POST("/v1/diagnoses", { body: { job: id }, signal: context.signal }));
    location.hash = link("diagnose", [job.id]);
  } catch (e) {
    button.disabled = false;
    context.fail(e);
  }
}
