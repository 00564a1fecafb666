// An open task: its stage, physics and films.

import type { Schema } from "../../api/client";
import { h, put } from "../../dom";
import { latest } from "../../parts/latest";
import type { Film } from "../../scene/film";
import type { Context } from "../../view";
import { comparisonChoice } from "./compare";
import { effects, latents } from "./physics";
import { actionPlacement, type SimulationSubject } from "./placement";
import { effectSwitches, sceneEffects } from "./sceneEffects";
import { goalTime, prior, simulate, type Physics } from "./simulation";
import { filmStage } from "./stage";
import type { Task } from "./taskPicker";

export interface TaskSession {
  stage: HTMLElement;
  controls: HTMLElement;
  action: () => number[];
  /** Shows a film of the real world. */
  onRan: (film: Film, solved: boolean | null) => void;
  start: () => Promise<void>;
  close: () => void;
}

/** Opens a task; `first` is its first action, `ready` is called with whether the action is valid. */
export function taskSession(task: Task, library: Schema<"EffectOut">[], first: readonly number[] | null, ready: (placeable: boolean) => void, outer: Context): TaskSession {
  // Requests of a closed task are aborted.
  const abort = new AbortController();
  const context: Context = { ...outer, signal: AbortSignal.any([outer.signal, abort.signal]) };
  const { scene } = task;
  const subject: SimulationSubject = task.family ? { task: task.id } : { scene: scene as unknown as Record<string, never> };
  const own = sceneEffects(scene, library);
  let [action, physics]: [number[] | null, Physics] = [null, { latents: {}, added: [], off: [] }];
  const comparison = comparisonChoice(own, () => physics, () => update(false));
  const stage = filmStage(scene, `Scene ${task.id}. Arrow keys move the object, brackets change its size or angle, N selects the next object, plus and minus zoom.`, context, task.box, comparison.element);
  const follow = async (): Promise<void> => {
    const compared = comparison.current(physics);
    const other = compared ? await simulate(task, action, compared.physics, context.signal) : null;
    stage.compared(compared?.title ?? "", other?.film ?? null);
  };
  const update = latest<boolean>(async (fresh) => {
    if (action === null && scene.action) return;
    try {
      const [placed, now] = [action, physics];
      const { film, solved, reason } = await simulate(task, placed, now, context.signal);
      if (fresh) stage.place(placed ?? [], reason);
      placement.showReason(reason);
      ready(reason === null);
      stage.simulated(film, solved, now.added.length > 0 || own.length > now.off.length);
      if (solved) stage.reached(await goalTime(task, placed, now, context.signal));
      await follow();
      context.fail(null);
    } catch (e) {
      context.fail(e);
    }
  });
  const placement = actionPlacement(scene, subject, stage, (moved) => {
    action = moved;
    // The real film belongs to the previous action.
    stage.real(null, null);
    stage.place(moved, null);
    update(true);
  }, context, first);
  const change = (part: Partial<Physics>): void => {
    physics = { ...physics, ...part };
    update(false);
  };
  const sliders = h("div", {});
  const start = async (): Promise<void> => {
    physics = { ...physics, latents: task.family ? await prior(task.family, context.signal) : {} };
    put(sliders, latents(scene, physics.latents, (now) => change({ latents: now })));
    update(true);
  };
  const switches = effectSwitches(own, (off) => change({ off }));
  const added = effects(library, (terms) => change({ added: structuredClone(terms) }));
  const part = (title: string, ...content: HTMLElement[]): HTMLElement => h("section", { class: "card", "aria-label": title }, h("h2", {}, title), ...content);
  return {
    stage: stage.element,
    controls: h("div", { class: "stack" }, part("Action", placement.element), part("Simulated latents", sliders), part("Effects of the scene", switches), part("Further effects", added)),
    action: placement.action,
    onRan: (film, solved) => {
      stage.real(film, solved);
      stage.restart();
    },
    start,
    close: () => abort.abort(),
  };
}
