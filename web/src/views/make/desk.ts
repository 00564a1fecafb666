// The draft on the desk: the scene with its history, what is selected, what the server says of it.

import { applyAction, share } from "../../scene/action";
import type { Scene } from "../../scene/types";
import { needsAction } from "./film";
import { begin, change, type History, redo, settle, undo } from "./history";
import { write } from "./path";
import { thing } from "./things";

/** What the server says is wrong. */
export interface Wrong {
  /** Of the scene, without `scene.` before it. */
  field: string;
  why: string;
}

export interface State {
  history: History<Scene>;
  /** `world`, `goal`, `action`, `effects`, `bodies[0]`, `statics[0]`. */
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

/** The scene as it is drawn, which is how the film starts: with the action carried out, where there is one. */
export function filled(state: State): Scene {
  const now = scene(state);
  if (!now.action || (state.action === null && !needsAction(now))) return now;
  return applyAction(now, state.action ?? now.action.components.map(() => 0.5));
}

/** The scene with what is at a place standing as it is drawn, so that it can be moved from there. */
export function grounded(state: State, place: string): Scene {
  const now = scene(state);
  const one = thing(now, place);
  const sets = now.action?.components.some((c) => c.target === one?.name);
  return one && sets ? write(now, place, thing(filled(state), place)) : now;
}

/** After a thing was moved by hand: it stands where it was put, and not where the action had put it. */
export function put(state: State, next: Scene, key: string | null): State {
  const done = changed(state, next, key);
  if (done.action === null || !next.action) return done;
  if (!needsAction(next)) return { ...done, action: null };
  const one = thing(next, state.selected);
  const radius = one?.shape.type === "disc" ? one.shape.radius : undefined;
  const set: Record<string, number | undefined> = { x: one?.position?.[0], y: one?.position?.[1], angle: one?.angle, radius };
  const action = next.action.components.map((c, i) => {
    const now = c.target === one?.name ? set[c.set] : undefined;
    return now === undefined ? done.action![i]! : share(c, now);
  });
  return { ...done, action };
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
  const [, place] = /^((?:bodies|statics)\[\d+\]|goal|action|effects)/.exec(field) ?? [];
  return place ?? "world";
}

/** An action that no longer fits is put away, and a selection of what is gone. */
function kept(state: State): State {
  const now = scene(state);
  const fits = state.action !== null && state.action.length === (now.action?.components.length ?? 0);
  const there = ["world", "goal", "action", "effects"].includes(state.selected) || thing(now, state.selected) !== null;
  return { ...state, action: fits ? state.action : null, selected: there ? state.selected : "world" };
}
