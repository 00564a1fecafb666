// State of the editor: the draft with its history, the selection, the server's problem.

import { applyAction, shareFor } from "../../scene/action";
import type { Scene } from "../../scene/types";
import { needsAction } from "./simulate";
import { begin, change, type History, redo, settle, undo } from "./history";
import { write } from "./path";
import { objectAt } from "./objects";

/** A problem that the server reports. */
export interface SceneProblem {
  /** Path within the scene, without the prefix `scene.`. */
  field: string;
  message: string;
}

export interface EditorState {
  history: History<Scene>;
  /** `world`, `goal`, `action`, `effects`, `bodies[0]`, `statics[0]`. */
  selected: string;
  problem: SceneProblem | null;
  /** The action that places bodies without a position and starts the film; `null`: as drawn. */
  action: number[] | null;
}

export function initialState(scene: Scene): EditorState {
  return { history: begin(scene), selected: "world", problem: null, action: null };
}

export function currentScene(state: EditorState): Scene {
  return state.history.present;
}

/** The scene as displayed, which is the initial state of the film: after the action, if any. */
export function displayedScene(state: EditorState): Scene {
  const now = currentScene(state);
  if (!now.action || (state.action === null && !needsAction(now))) return now;
  return applyAction(now, state.action ?? now.action.components.map(() => 0.5));
}

/** The scene with the object's displayed position stored in it, so that it can be moved from there. */
export function withDisplayedPose(state: EditorState, place: string): Scene {
  const now = currentScene(state);
  const object = objectAt(now, place);
  const sets = now.action?.components.some((c) => c.target === object?.name);
  return object && sets ? write(now, place, objectAt(displayedScene(state), place)) : now;
}

/** Applies a manual move: the object's position replaces the one set by the action. */
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

/** The entry of the object list that a field belongs to. */
export function locationOf(field: string): string {
  const [, place] = /^((?:bodies|statics)\[\d+\]|goal|action|effects)/.exec(field) ?? [];
  return place ?? "world";
}

/** Removes an action that no longer matches, and a selection that no longer exists. */
function validated(state: EditorState): EditorState {
  const now = currentScene(state);
  const fits = state.action !== null && state.action.length === (now.action?.components.length ?? 0);
  const exists = ["world", "goal", "action", "effects"].includes(state.selected) || objectAt(now, state.selected) !== null;
  return { ...state, action: fits ? state.action : null, selected: exists ? state.selected : "world" };
}
