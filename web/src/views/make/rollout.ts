// Below the picture: the film of the draft, its outcome, and the initial action.

import { reconnected, isLost } from "../../api/connection";
import { ProblemError, describeError } from "../../api/problem";
import { uniqueId, h, put } from "../../dom";
import { latest } from "../../parts/latest";
import { player } from "../../parts/player";
import { short } from "../../parts/slider";
import { filmLength } from "../../scene/film";
import { unit, valueAt } from "../../scene/action";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";
import type { Canvas } from "./canvas";
import { currentScene, type EditorState, type SceneProblem } from "./editorState";
import { needsAction, findValidAction, type SimulationResult, simulate } from "./simulate";

export interface Rollout {
  element: HTMLElement;
  /** Call after a change of the draft: simulates it, if "Run as you draw" is on. */
  changed: () => void;
}

/** Receives the results of a rollout. */
export interface RolloutListener {
  /** The problem of a scene, which may no longer be the draft. */
  onProblem: (problem: SceneProblem | null, of: Scene) => void;
  onAction: (action: number[] | null) => void;
}

/** `state`: the draft; `isDragging`: whether a gesture is in progress, during which the film does not restart. */
export function rollout(at: Canvas, state: () => EditorState, isDragging: () => boolean, listener: RolloutListener, context: Context): Rollout {
  const { signal } = context;
  const play = player(at.time, signal);
  const id = uniqueId("live");
  const live = h("input", { id, type: "checkbox" });
  live.checked = true;
  const once = h("button", { type: "button" }, "Run");
  const verdict = h("span", { class: "badge sim", role: "status" });
  const [another, startAsDrawn] = [h("button", { type: "button" }, "Try another action"), h("button", { type: "button" }, "Start as drawn")];
  const actionLabel = h("span", { class: "soft" });
  const acting = h("div", { class: "row acting" }, actionLabel, another, startAsDrawn);
  let [attempts, failed] = [0, false];
  // Only remove errors that were displayed here: a successful simulation must not remove the error of a file.
  const fail = (error: unknown): void => {
    if (error !== null || failed) context.fail(error);
    failed = error !== null;
  };
  const note = (words: string | null): void => {
    put(verdict, words);
    verdict.hidden = words === null;
  };
  const show = (run: SimulationResult | null): void => {
    note(run ? outcomeText(run) : null);
    verdict.dataset.verdict = run?.solved ? "solved" : "";
    at.film(run?.film ?? null);
    play.load(run?.film ? filmLength(run.film) : 0);
    if (run?.film && !isDragging()) play.restart();
  };
  const describe = (): void => {
    const [now, { action }] = [currentScene(state()), state()];
    acting.hidden = !now.action;
    once.hidden = live.checked;
    startAsDrawn.hidden = action === null || needsAction(now);
    put(actionLabel, action ? `Starts with ${actionText(now, action)}.` : "Starts as drawn.");
  };
  const work = latest<boolean>(async (requested) => {
    describe();
    const now = currentScene(state());
    // An empty draft is not an error. With "Run as you draw" off, simulate only on request.
    if (!now.bodies.length || !(live.checked || requested)) {
      listener.onProblem(null, now);
      show(null);
      if (!now.bodies.length) note("Nothing moves yet: draw a disc, a box or a polygon.");
      return;
    }
    try {
      const done = await simulateWithAction(now, state().action, listener.onAction, signal);
      fail(null);
      listener.onProblem(null, now);
      show(done);
    } catch (e) {
      if (signal.aborted) return;
      const field = e instanceof ProblemError ? scenePath(e.problem.field) : null;
      fail(field === null ? e : null);
      if (field !== null) listener.onProblem({ field, message: describeError(e).detail }, now);
      show(null);
      if (isLost()) void reconnected().then(() => signal.aborted || work(requested));
    }
    describe();
  });
  another.addEventListener("click", () => {
    attempts += 1;
    findValidAction(currentScene(state()), 1 + 37 * attempts, signal)
      .then((validAction) => (listener.onAction(validAction), work(true)))
      .catch(context.fail);
  });
  startAsDrawn.addEventListener("click", () => (listener.onAction(null), work(true)));
  live.addEventListener("change", () => work(false));
  once.addEventListener("click", () => work(true));
  show(null);
  const element = h(
    "div",
    { class: "stack" },
    play.element,
    h("div", { class: "row" }, h("span", { class: "row" }, live, h("label", { for: id }, "Run as you draw")), once, verdict),
    acting,
  );
  return { element, changed: () => work(false) };
}

/** Simulates the draft. If it needs an action, or its action is no longer valid, another one is searched for. */
async function simulateWithAction(now: Scene, action: number[] | null, onChosen: (action: number[] | null) => void, signal: AbortSignal): Promise<SimulationResult> {
  if (action || !needsAction(now)) {
    const done = await simulate(now, action, signal);
    if (done.reason === null) return done;
  }
  const validAction = await findValidAction(now, 0, signal);
  onChosen(validAction);
  if (validAction) return simulate(now, validAction, signal);
  return { film: null, solved: null, end: null, reason: "no valid action was found" };
}

/** A field path within the scene; `null` for other fields. Effects are named without the prefix `scene`: requests here have no
 * other effects. */
function scenePath(field: string | null | undefined): string | null {
  const [, path] = /^(?:scene\.|(?=effects\[))(.*)$/.exec(field ?? "") ?? [];
  return path ?? (field === "scene" ? "" : null);
}

function outcomeText({ film, solved, end: how, reason }: SimulationResult): string {
  if (reason) return `Not run: ${reason}`;
  if (how === "diverged") return "The simulation diverged";
  const time = film ? short(filmLength(film), "s") : "";
  if (solved === null) return `Ran ${time}; no goal`;
  return solved ? `Goal reached at ${time}` : `Goal not reached in ${time}`;
}

function actionText(now: Scene, action: readonly number[]): string {
  return (now.action?.components ?? []).map((c, i) => `${c.target} ${c.set} ${short(valueAt(c, action[i] ?? 0.5), unit(c))}`).join(", ");
}
