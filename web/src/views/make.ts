// Make: a scene is drawn, and runs while one draws.

import { h, put } from "../dom";
import { type Scene } from "../scene/types";
import { type Context, link, type View } from "../view";
import { canvas } from "./make/canvas";
import { changed, filled, grounded, placeOf, put as stood, redone, scene, settled, started, type State, undone, type Wrong } from "./make/desk";
import { empty, files, keep, kept } from "./make/files";
import { gestures, type Hand } from "./make/gestures";
import { HELP, keys } from "./make/keys";
import { list } from "./make/list";
import type { Desk } from "./make/panels";
import { rollout } from "./make/rollout";
import { sheet } from "./make/sheet";
import { doubled, removed, thing } from "./make/things";
import { toolbar } from "./make/toolbar";
import type { Tool } from "./make/tools";
import { load } from "./play/tasks";
import "./make.css";

export const make: View = {
  id: "make",
  title: "Make",
  about: "Draw a scene, watch it run while you draw, make a world of it.",
  open,
};

async function open(place: HTMLElement, context: Context): Promise<void> {
  const task = context.query.get("task");
  const first = task ? (await load(task, context.signal)).scene : (kept() ?? empty());
  // A reload is to bring the draft back, and not the task again.
  if (task) history.replaceState(null, "", link("make"));
  const now = studio(first, context);
  const said = h("p", { class: "soft said", role: "status" });
  const { element, drop } = await files(now.scene, now.open, (text) => put(said, text), context);
  put(place, h("div", { class: "card stack" }, element, said), now.element);
  dropped(place, drop, context.signal);
  now.start();
}

/** The desk: the picture that is drawn in, the list of things, the form. */
function studio(first: Scene, context: Context): { element: HTMLElement; scene: () => Scene; open: (scene: Scene) => void; start: () => void } {
  const { signal } = context;
  let state: State = started(first);
  let [tool, moving, held, loaded]: [Tool, boolean, boolean, boolean] = ["select", true, false, true];
  const at = canvas(LABEL, first, signal);
  const things = list((place) => select(place));
  const problem = h("div", { class: "problem", role: "alert", hidden: true });
  const render = (): void => {
    const wrong = state.wrong && placeOf(state.wrong.field);
    at.show({ scene: filled(state), selected: state.selected, bad: (wrong && thing(scene(state), wrong)?.name) ?? null });
    things.show(scene(state), state.selected, wrong);
    form.show(state);
    bar.show(tool, moving, state.history.past.length > 0, state.history.future.length > 0);
    at.svg.dataset.tool = tool;
  };
  const update = (next: State): void => {
    state = next;
    keep(scene(state));
    render();
    film.changed();
  };
  const select = (place: string): void => {
    if (place === state.selected) return;
    state = settled({ ...state, selected: place });
    render();
    context.say(`${thing(scene(state), place)?.name ?? place} is selected.`);
  };
  const choose = (next: Tool): void => {
    corners.drop();
    tool = next;
    if (next !== "box") moving = next !== "segment";
    render();
    if (next !== "select") at.svg.focus({ preventScroll: true });
  };
  const desk: Desk = { scene: () => scene(state), change: (next, key) => update(changed(state, next, key)), select };
  const hand: Hand = {
    scene: () => filled(state),
    grounded: (place) => grounded(state, place),
    selected: () => state.selected,
    tool: () => tool,
    moving: () => moving,
    select,
    change: (next, key) => {
      held = key.startsWith("drag-");
      update(stood(state, next, key));
    },
    drew: (done) => {
      if (!done) return context.say("Nothing was drawn: it has no size, or there is nothing it could be about.");
      update({ ...changed(settled(state), done.scene, null), selected: done.place });
      choose("select");
      context.say(`${thing(scene(state), done.place)?.name ?? done.place} was drawn.`);
    },
    over: () => {
      if (!held) return;
      held = false;
      state = settled(state);
      film.changed();
    },
  };
  const form = sheet(desk);
  const bar = toolbar({
    tool: choose,
    moving: (now) => (moving = now),
    undo: () => update(undone(state)),
    redo: () => update(redone(state)),
    zoom: at.zoom,
    fit: at.fit,
  });
  const corners = gestures(at, hand, signal);
  keys(at, hand, corners, {
    tool: choose,
    remove: () => thing(scene(state), state.selected) && update(changed(state, removed(scene(state), state.selected), null)),
    duplicate: () => {
      if (thing(scene(state), state.selected)) hand.drew(doubled(grounded(state, state.selected), state.selected, 10 * at.step()));
    },
    form: form.focus,
  }, signal);
  const film = rollout(at, () => state, () => held, {
    wrong: (wrong) => {
      if (!wrong && !state.wrong) return;
      state = { ...state, wrong };
      // Of a scene that was opened the first mistake is gone to; while one draws, nothing is taken out of one's hand.
      if (wrong && loaded) state = { ...state, selected: placeOf(wrong.field) };
      loaded &&= wrong === null;
      put(problem, ...complaint(wrong, state, select, form.focus));
      problem.hidden = wrong === null;
      render();
    },
    action: (action) => {
      state = { ...state, action };
      render();
    },
  }, context);
  shortcuts(() => update(undone(state)), () => update(redone(state)), signal);
  const stage = h("div", { class: "stage" }, bar.element, bar.hint, at.svg, problem, film.element, help());
  const side = h("div", { class: "stack" }, h("section", { class: "card", "aria-label": "Things" }, things.element), form.element);
  return {
    element: h("div", { class: "make-body" }, stage, side),
    scene: () => scene(state),
    open: (next) => {
      loaded = true;
      update({ ...changed(settled(state), next, null), selected: "world", action: null });
      at.fit();
    },
    start: () => {
      render();
      at.fit();
      film.changed();
    },
  };
}

const LABEL = "The scene. Arrow keys move what is selected, N takes the next thing, Enter goes to its numbers or draws with the tool that is chosen, letters choose tools.";

/** What is wrong in the server's words, and the way to the field where it is out of sight. */
function complaint(wrong: Wrong | null, state: State, select: (place: string) => void, focus: () => void): HTMLElement[] {
  if (!wrong) return [];
  const place = placeOf(wrong.field);
  const text = h("p", {}, wrong.why);
  const go = h("button", { type: "button" }, `Go to ${thing(scene(state), place)?.name ?? place}`);
  go.addEventListener("click", () => (select(place), focus()));
  return [text, go];
}

function help(): HTMLElement {
  const rows = HELP.flatMap(([key, what]) => [h("dt", {}, key), h("dd", {}, what)]);
  return h("details", {}, h("summary", {}, "Keys in the picture"), h("dl", { class: "facts" }, ...rows));
}

/** Undo and redo from anywhere but a field, which has its own. */
function shortcuts(undo: () => void, redo: () => void, signal: AbortSignal): void {
  addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    const typing = event.target instanceof HTMLInputElement && event.target.type !== "checkbox" && event.target.type !== "range";
    if (!(event.ctrlKey || event.metaKey) || typing || !["z", "y"].includes(key)) return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) redo();
    else undo();
  }, { signal });
}

/** Files that are dropped anywhere in the view. */
function dropped(place: HTMLElement, drop: (file: File) => void, signal: AbortSignal): void {
  place.addEventListener("dragover", (event) => event.preventDefault(), { signal });
  place.addEventListener("drop", (event) => {
    event.preventDefault();
    const file = event.dataTransfer?.files[0];
    if (file) drop(file);
  }, { signal });
}
