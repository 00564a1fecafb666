// Under the picture: the film of the draft, what it came to, with which action it starts.

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
import { scene, type State, type Wrong } from "./desk";
import { needsAction, placeable, type Run, run } from "./film";

export interface Rollout {
  element: HTMLElement;
  /** The draft is another one: runs it, if drafts are run while one draws. */
  changed: () => void;
}

/** What a rollout tells of the draft. */
export interface Told {
  /** What is wrong with a scene, which may no longer be the draft. */
  wrong: (wrong: Wrong | null, of: Scene) => void;
  action: (action: number[] | null) => void;
}

/** `state` is the draft; `held` says whether a gesture is under way, during which the film does not start anew. */
export function rollout(at: Canvas, state: () => State, held: () => boolean, tell: Told, context: Context): Rollout {
  const { signal } = context;
  const play = player(at.time, signal);
  const id = uniqueId("live");
  const live = h("input", { id, type: "checkbox" });
  live.checked = true;
  const once = h("button", { type: "button" }, "Run");
  const verdict = h("span", { class: "badge sim", role: "status" });
  const [another, drawn] = [h("button", { type: "button" }, "Try another action"), h("button", { type: "button" }, "Start as drawn")];
  const said = h("span", { class: "soft" });
  const acting = h("div", { class: "row acting" }, said, another, drawn);
  let [tried, failed] = [0, false];
  // What is shown above the view is taken away by who showed it: a wrong file is not forgiven by a film.
  const fail = (error: unknown): void => {
    if (error !== null || failed) context.fail(error);
    failed = error !== null;
  };
  const note = (words: string | null): void => {
    put(verdict, words);
    verdict.hidden = words === null;
  };
  const show = (run: Run | null): void => {
    note(run ? came(run) : null);
    verdict.dataset.verdict = run?.solved ? "solved" : "";
    at.film(run?.film ?? null);
    play.load(run?.film ? filmLength(run.film) : 0);
    if (run?.film && !held()) play.restart();
  };
  const describe = (): void => {
    const [now, { action }] = [scene(state()), state()];
    acting.hidden = !now.action;
    once.hidden = live.checked;
    drawn.hidden = action === null || needsAction(now);
    put(said, action ? `Starts with ${worded(now, action)}.` : "Starts as drawn.");
  };
  const work = latest<boolean>(async (asked) => {
    describe();
    const now = scene(state());
    // An empty draft is no mistake; and what is off is run when it is asked for.
    if (!now.bodies.length || !(live.checked || asked)) {
      tell.wrong(null, now);
      show(null);
      if (!now.bodies.length) note("Nothing moves yet: draw a disc, a box or a polygon.");
      return;
    }
    try {
      const done = await acted(now, state().action, tell.action, signal);
      fail(null);
      tell.wrong(null, now);
      show(done);
    } catch (e) {
      if (signal.aborted) return;
      const field = e instanceof ProblemError ? ofScene(e.problem.field) : null;
      fail(field === null ? e : null);
      if (field !== null) tell.wrong({ field, why: describeError(e).detail }, now);
      show(null);
      if (isLost()) void reconnected().then(() => signal.aborted || work(asked));
    }
    describe();
  });
  another.addEventListener("click", () => {
    tried += 1;
    placeable(scene(state()), 1 + 37 * tried, signal)
      .then((found) => (tell.action(found), work(true)))
      .catch(context.fail);
  });
  drawn.addEventListener("click", () => (tell.action(null), work(true)));
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

/** Runs the draft; where it needs an action, or the one it had has no place any more, another one is looked for. */
async function acted(now: Scene, action: number[] | null, chosen: (action: number[] | null) => void, signal: AbortSignal): Promise<Run> {
  if (action || !needsAction(now)) {
    const done = await run(now, action, signal);
    if (done.reason === null) return done;
  }
  const found = await placeable(now, 0, signal);
  chosen(found);
  if (found) return run(now, found, signal);
  return { film: null, solved: null, end: null, reason: "no action was found that has a place" };
}

/** A field of the scene, as a scene's own paths go; `null` of anything else. Effects are named without the scene: no others
 * are asked for here. */
function ofScene(field: string | null | undefined): string | null {
  const [, own] = /^(?:scene\.|(?=effects\[))(.*)$/.exec(field ?? "") ?? [];
  return own ?? (field === "scene" ? "" : null);
}

function came({ film, solved, end: how, reason }: Run): string {
  if (reason) return `Not run: ${reason}`;
  if (how === "diverged") return "The simulation diverged";
  const time = film ? short(filmLength(film), "s") : "";
  if (solved === null) return `Ran ${time}; no goal`;
  return solved ? `Goal reached at ${time}` : `Goal not reached in ${time}`;
}

function worded(now: Scene, action: readonly number[]): string {
  return (now.action?.components ?? []).map((c, i) => `${c.target} ${c.set} ${short(valueAt(c, action[i] ?? 0.5), unit(c))}`).join(", ");
}
