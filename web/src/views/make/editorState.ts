// The draft on the desk: the scene with its history, what is selected, what the server says of it.

import { applyAction, shareFor } from "../../scene/action";
import type { Scene } from "../../scene/types";
import { needsAction } from "./simulate";
import { begin, change, type History, redo, settle, undo } from "./history";
import { write } from "./path";
import { objectAt } from "./objects";

/** What the server says is wrong. */
export interface SceneProblem {
  /** Of the scene, without `scene.` before it. */
  field: string;
  message: string;
}

export interface EditorState {
  history: History<Scene>;
  /** `world`, `goal`, `action`, `effects`, `bodies[0]`, `statics[0]`. */
  selected: string;
  problem: SceneProblem | null;
  /** The action that bodies without a position stand by, and that the film starts with; `null`: as it is drawn. */
  action: number[] | null;
}

export function initialState(scene: Scene): EditorState {
  return { history: begin(scene), selected: "world", problem: null, action: null };
}

export function currentScene(state: EditorState): Scene {
  return state.history.present;
}

/** The scene as it is drawn, which is how the film starts: with the action carried out, where there is one. */
export function displayedScene(state: EditorState): Scene {
  const now = currentScene(state);
  if (!now.action || (state.action === null && !needsAction(now))) return now;
  return applyAction(now, state.action ?? now.action.components.map(() => 0.5));
}

/** The scene with what is at a place standing as it is drawn, so that it can be moved from there. */
export function withDisplayedPose(state: EditorState, place: string): Scene {
  const now = currentScene(state);
  const object = objectAt(now, place);
  const sets = now.action?.components.some((c) => c.target === object?.name);
  return object && sets ? write(now, place, objectAt(displayedScene(state), place)) : now;
}

/** After a thing was moved by hand: it stands where it was put, and not where the action had put it. */
export function moveObject(state: EditorState, next: Scene, key: string | null): EditorState {
  const done = applyChange(state, next, key);
  if (done.action === null || !next.action) return done;
  if (!needsAction(next)) return { ...done, action: null };
  const object = objectAt(next, state.selected);
  const radius = object?.shape.type === "disc" ? object.shape.radius : undefined;
  const set: Record<string, number | undefined> = { x: object?.position?.[0], y: object?.position?.[1], angle: object?.angle, radius };
  const action = next.action.components.map((c, i) => {
    const now = c.target === object?.name ? set[c.set] : undefined;
    return now === undefined ? done.action![i]! : shareFor(c, now);
  });
  return { ...done, action };
}

export function applyChange(state: EditorState, next: Scene, key: string | null): EditorState {
  return validated({ ...state, history: change(state.history, next, key) });
}

export function endGesture(state: EditorState): EditorState {
  return { ...state, history: settle(state.history) };
}

export function undoChange(state: EditorState): EditorState {
  return validated({ ...state, history: undo(state.history) });
}

export function redoChange(state: EditorState): EditorState {
  return validated({ ...state, history: redo(state.history) });
}

/** Where in the list what is wrong stands. */
export function locationOf(field: string): string {
  const [, place] = /^((?:bodies|statics)\[\d+\]|goal|action|effects)/.exec(field) ?? [];
  return place ?? "world";
}

/** An action that no longer fits is put away, and a selection of what is gone. */
function validated(state: EditorState): EditorState {
  const now = currentScene(state);
  const fits = state.action !== null && state.action.length === (now.action?.components.length ?? 0);
  const exists = ["world", "goal", "action", "effects"].includes(state.selected) || objectAt(now, state.selected) !== null;
  return { ...state, action: fits ? state.action : null, selected: exists ? state.selected : "world" };
}
