// Tries an action right there: its film in a simulated world, and on request in a real one.

import { h, put } from "../../dom";
import { latest } from "../../parts/latest";
import { type Context, link } from "../../view";
import { realWorld } from "../play/realWorld";
import { filmStage } from "../play/stage";
import { loadTask } from "../play/taskPicker";
import { physicsText, simulateAction } from "./physics";
import type { World, Worlds } from "./worlds";

export interface TryPanel {
  element: HTMLElement;
  /** Simulates an action of a task and plays its film. */
  show: (task: string, action: readonly number[], name: string) => void;
}

/** The address of an action in Play. */
export function playLink(task: string, action: readonly number[]): string {
  return link("play", [task], { action: action.map((v) => String(Number(v.toFixed(6)))).join(",") });
}

interface Attempt {
  task: string;
  action: readonly number[];
  name: string;
  world: World;
  /** Whether to scroll to it. */
  reveal: boolean;
}

/** A panel without an action; `worlds` are those of the analysis. */
export function tryPanel(worlds: Worlds, context: Context): TryPanel {
  const [heading, place] = [h("h2", {}, "Try an action"), h("div", { class: "stack" })];
  const element = h("section", { class: "card stack try-panel", "aria-label": "Try" }, heading, place);
  let session = new AbortController();
  let number = 0;
  let requested: Attempt | null = null;
  const simulate = latest<Attempt>(async (attempt) => {
    session.abort();
    session = new AbortController();
    const inner: Context = { ...context, signal: AbortSignal.any([context.signal, session.signal]) };
    await film(place, attempt, next(attempt), inner).catch((error: unknown) => {
      put(place);
      context.fail(error);
    });
    if (requested === attempt) busy(place, false);
    if (attempt.reveal) reveal(element);
  });
  // The film and the buttons of the previous action are inert until those of this one replace them.
  const run = (attempt: Attempt): void => {
    requested = attempt;
    busy(place, true);
    simulate(attempt);
  };
  /** The same action in another sample. */
  const next = (attempt: Attempt): (() => void) | null => {
    const { sample, count } = worlds;
    if (!sample) return null;
    return () => {
      // A stride through the samples, which are ordered by run.
      number = (number + Math.max(1, Math.round(count * 0.382))) % count;
      run({ ...attempt, world: sample(number), reveal: false });
    };
  };
  const show = (task: string, action: readonly number[], name: string): void => {
    put(heading, `${name} in ${task}`);
    run({ task, action, name, world: worlds, reveal: element.isConnected });
  };
  return { element, show };
}

function busy(place: HTMLElement, busy: boolean): void {
  place.inert = busy;
  place.setAttribute("aria-busy", String(busy));
}

/** Scrolls to an element unless its upper part is in sight. */
function reveal(element: HTMLElement): void {
  const { top } = element.getBoundingClientRect();
  if (top < 0 || top > innerHeight / 2) element.scrollIntoView({ block: "start" });
}

/** The film of an attempt, with a button for the real world. */
async function film(place: HTMLElement, attempt: Attempt, another: (() => void) | null, context: Context): Promise<void> {
  const { task, action, world } = attempt;
  const loaded = await loadTask(task, context.signal);
  const answer = await simulateAction(task, loaded.scene, action, world.physics, context.signal);
  const stage = filmStage(loaded.scene, `${attempt.name} in ${task}`, context, loaded.box);
  const real = realWorld(() => [...action], (run) => (stage.real(run.film, run.solved), stage.restart()), (other) => (location.hash = link("play", [other])), context);
  stage.place(action, answer.reason ?? null);
  if (answer.valid) stage.simulated({ t: answer.t, bodies: answer.bodies, contacts: answer.contacts }, answer.solved ?? null, world.physics.effects.length + (world.physics.field?.length ?? 0) > 0);
  const again = another ? h("button", { type: "button" }, "Another sample") : null;
  again?.addEventListener("click", () => another?.());
  const physics = h("p", { class: "soft simulated-world" }, `Simulated with ${world.name}: ${physicsText(world.physics)}.`);
  const play = h("a", { href: playLink(task, action) }, "Open in Play");
  const cost = h("p", { class: "soft" }, "The simulation is free. Each run in a real world costs one interaction.");
  const reason = answer.valid ? null : h("p", { class: "field-error" }, `This action cannot be placed: ${answer.reason ?? "no reason stated"}.`);
  put(place, stage.element, reason, physics, h("div", { class: "row" }, again, play), cost, real.element);
  stage.restart();
  context.say(`${attempt.name}: ${answer.solved ? "solves the task" : "does not solve the task"} in simulation.`);
  await real.about(loaded);
  real.ready(answer.valid);
}
