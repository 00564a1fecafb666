// The draft on the desk: the scene with its history, what is selected, what the server says of it.

import { placed } from "../../scene/place";
import type { Scene } from "../../scene/types";
import { begin, change, type History, redo, settle, undo } from "./history";
import { write } from "./path";
import { moves, thing } from "./things";

/** What the server says is wrong. */
export interface Wrong {
  /** Of the scene, without `scene.` before it. */
  field: string;
  why: string;
}

export interface State {
  history: History<Scene>;
  /** `world`, `goal`, `action`, `bodies[0]`, `statics[0]`. */
  selected: string;
  wrong: Wrong | null;
  /** The action that bodies without a position stand by, and that the film starts with; `null`: as it is drawn. */
  action: number[] | null;
}

export function started(scene: Scene): State {
  return { history: begin(scene), selected: "world", wrong: null, action: null };
}

export function scene(state: State): Scene {
  return state.history.now;
}

/** The scene as it is drawn: bodies that only an action places stand where it places them. */
export function filled(state: State): Scene {
  const now = scene(state);
  if (!now.action || now.bodies.every((b) => b.position)) return now;
  const stood = placed(now, state.action ?? now.action.components.map(() => 0.5));
  return { ...now, bodies: now.bodies.map((b, i) => (b.position ? b : { ...b, ...spot(stood.bodies[i]?.position) })) };
}

/** The scene with what is at a place standing where it is drawn, so that it can be moved from there. */
export function grounded(state: State, place: string): Scene {
  const now = scene(state);
  const one = thing(now, place);
  if (!one || one.position || !moves(place)) return now;
  return write(now, `${place}.position`, thing(filled(state), place)?.position ?? [0, 0]);
}

export function changed(state: State, next: Scene, key: string | null): State {
  return kept({ ...state, history: change(state.history, next, key) });
}

export function settled(state: State): State {
  return { ...state, history: settle(state.history) };
}

export function undone(state: State): State {
  return kept({ ...state, history: undo(state.history) });
}

export function redone(state: State): State {
  return kept({ ...state, history: redo(state.history) });
}

/** Where in the list what is wrong stands. */
export function placeOf(field: string): string {
  const [, place] = /^((?:bodies|statics)\[\d+\]|goal|action)/.exec(field) ?? [];
  return place ?? "world";
}

/** An action that no longer fits is put away, and a selection of what is gone. */
function kept(state: State): State {
  const now = scene(state);
  const fits = state.action !== null && state.action.length === (now.action?.components.length ?? 0);
  const there = ["world", "goal", "action"].includes(state.selected) || thing(now, state.selected) !== null;
  return { ...state, action: fits ? state.action : null, selected: there ? state.selected : "world" };
}

function spot(position: [number, number] | null | undefined): { position?: [number, number] } {
  return position ? { position } : {};
}
