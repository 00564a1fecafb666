// The editor: the picture that is drawn in, the list of things, the form, and the film, over one draft.

import { h, put } from "../../dom";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";
import { canvas, type Canvas } from "./canvas";
import { changed, filled, grounded, placeOf, put as stood, redone, scene, settled, started, type State, undone } from "./desk";
import type { Library } from "./effects";
import { empty, keep, kept } from "./files";
import { gestures, type Hand } from "./gestures";
import { type Commands, HELP, keys } from "./keys";
import { list } from "./list";
import { rollout, type Told } from "./rollout";
import { type Sheet, sheet } from "./sheet";
import { doubled, removed, thing } from "./things";
import { toolbar } from "./toolbar";
import { nothing, type Tool } from "./tools";

export interface Studio {
  element: HTMLElement;
  scene: () => Scene;
  /** Draws on another scene; undo brings the one before back. */
  open: (scene: Scene) => void;
  /** When the element is on the page. */
  start: () => void;
}

/** What the editor is at. */
interface Now {
  state: State;
  tool: Tool;
  /** Whether what is drawn moves. */
  moving: boolean;
  /** Whether something is being dragged. */
  held: boolean;
  /** Whether the scene was opened just now: its first mistake is gone to. */
  fresh: boolean;
}

/** What changes it, and shows the change. */
interface Acts {
  update: (state: State) => void;
  render: () => void;
  select: (place: string) => void;
  choose: (tool: Tool) => void;
  /** Runs the draft. */
  run: () => void;
  /** To screen readers; `shown`: to everybody, until something changes. */
  say: (text: string, shown?: boolean) => void;
}

/** The draft with its history, while the page stands: Play and back loses nothing. */
let last: State | null = null;

/** The editor over a scene; for `null` over the draft of this tab. */
export function studio(first: Scene | null, library: Library, context: Context): Studio {
  const { signal } = context;
  const now: Now = { state: first ? started(first) : (last ?? started(kept() ?? empty())), tool: "select", moving: true, held: false, fresh: true };
  const at = canvas(LABEL, scene(now.state), signal);
  const things = list((place) => acts.select(place));
  const problem = h("div", { class: "problem", role: "alert", hidden: true });
  const render = (): void => {
    const { state, tool, moving } = now;
    const wrong = state.wrong && placeOf(state.wrong.field);
    at.show({ scene: filled(state), selected: state.selected, bad: (wrong && thing(scene(state), wrong)?.name) ?? null });
    things.show(scene(state), state.selected, wrong);
    form.show(state);
    bar.show(tool, moving, state.history.past.length > 0, state.history.future.length > 0);
    told(problem, state, acts.select, form);
    at.svg.dataset.tool = tool;
  };
  const update = (state: State): void => {
    now.state = last = state;
    keep(scene(state));
    render();
    film.changed();
  };
  const select = (place: string): void => {
    if (place === now.state.selected) return;
    now.state = settled({ ...now.state, selected: place });
    render();
    context.say(`${named(now.state, place)} is selected.`);
  };
  const choose = (tool: Tool): void => {
    corners.drop();
    now.tool = tool;
    if (tool !== "box") now.moving = tool !== "segment";
    render();
    if (tool !== "select") at.svg.focus({ preventScroll: true });
  };
  const say = (text: string, shown = false): void => {
    context.say(text);
    if (shown) bar.tell(text);
  };
  const acts: Acts = { update, render, select, choose, run: () => film.changed(), say };
  const form = sheet({ scene: () => scene(now.state), change: (next, key) => update(changed(now.state, next, key)), select, library });
  const back = (): void => update(undone(now.state));
  const again = (): void => update(redone(now.state));
  const bar = toolbar({ tool: choose, moving: (moving) => (now.moving = moving), undo: back, redo: again, zoom: at.zoom, fit: at.fit });
  const hand = handOf(now, acts);
  const corners = gestures(at, hand, signal);
  keys(at, hand, corners, commands(now, acts, hand, form, at), signal);
  const film = rollout(at, () => now.state, () => now.held, heard(now, acts), context);
  shortcuts(back, again, signal);
  const stage = h("div", { class: "stage" }, bar.element, bar.hint, at.svg, problem, film.element, help());
  const side = h("div", { class: "stack" }, h("section", { class: "card", "aria-label": "Things" }, things.element), form.element);
  return {
    element: h("div", { class: "make-body" }, stage, side),
    scene: () => scene(now.state),
    open: (next) => {
      now.fresh = true;
      update({ ...changed(settled(now.state), next, null), selected: "world", action: null });
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

/** What mouse and keyboard do to the draft. */
function handOf(now: Now, acts: Acts): Hand {
  return {
    scene: () => filled(now.state),
    grounded: (place) => grounded(now.state, place),
    selected: () => now.state.selected,
    tool: () => now.tool,
    moving: () => now.moving,
    select: acts.select,
    change: (next, key) => {
      now.held = key.startsWith("drag-");
      acts.update(stood(now.state, next, key));
    },
    drew: (done) => {
      if (!done) return acts.say(nothing(scene(now.state), now.tool), true);
      acts.update({ ...changed(settled(now.state), done.scene, null), selected: done.place });
      acts.choose("select");
      acts.say(`${named(now.state, done.place)} was drawn.`);
    },
    over: () => {
      if (!now.held) return;
      now.held = false;
      now.state = settled(now.state);
      acts.run();
    },
  };
}

function commands(now: Now, acts: Acts, hand: Hand, form: Sheet, at: Canvas): Commands {
  const chosen = (): boolean => thing(scene(now.state), now.state.selected) !== null;
  return {
    tool: acts.choose,
    remove: () => {
      if (chosen()) acts.update({ ...changed(now.state, removed(scene(now.state), now.state.selected), null), selected: "world" });
    },
    duplicate: () => {
      if (chosen()) hand.drew(doubled(grounded(now.state, now.state.selected), now.state.selected, 10 * at.step()));
    },
    form: form.focus,
  };
}

/** What a rollout says of the draft. */
function heard(now: Now, acts: Acts): Told {
  return {
    wrong: (wrong, of) => {
      // What a scene before this one has says nothing of it.
      const fresh = now.fresh && of === scene(now.state);
      if (fresh) now.fresh = false;
      if (!wrong && !now.state.wrong) return;
      // Of a scene that was opened the first mistake is gone to; while one draws, nothing is taken out of one's hand.
      const selected = wrong && fresh ? placeOf(wrong.field) : now.state.selected;
      now.state = { ...now.state, wrong, selected };
      acts.render();
    },
    action: (action) => {
      // Found for a scene that had other components.
      if (action && action.length !== scene(now.state).action?.components.length) return;
      now.state = { ...now.state, action };
      acts.render();
    },
  };
}

/** What is wrong in the server's words, and the way to its field; said again only if it is something else. */
function told(problem: HTMLElement, state: State, select: (place: string) => void, form: Sheet): void {
  const { wrong } = state;
  const said = wrong ? `${wrong.field} ${wrong.why}` : "";
  if (problem.dataset.said === said) return;
  problem.dataset.said = said;
  problem.hidden = wrong === null;
  if (!wrong) return void put(problem);
  const place = placeOf(wrong.field);
  const go = h("button", { type: "button" }, `Go to ${named(state, place)}`);
  go.addEventListener("click", () => (select(place), form.focus()));
  put(problem, h("p", {}, wrong.why), go);
}

function named(state: State, place: string): string {
  return thing(scene(state), place)?.name ?? place;
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
