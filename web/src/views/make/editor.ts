// The editor of one draft: picture, list of objects, form, film.

import { h, put } from "../../dom";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";
import { canvas, type Canvas } from "./canvas";
import { applyChange, displayedScene, withDisplayedPose, locationOf, moveObject as stood, redoChange, currentScene, endGesture, initialState, type EditorState, undoChange } from "./editorState";
import type { Library } from "./panel";
import { empty, storeDraft, storedDraft } from "./files";
import { pointerInput, type EditorActions } from "./pointer";
import { type Commands, KEYBOARD_HELP, keys } from "./keyboard";
import { objectList } from "./objectList";
import { rollout, type RolloutListener } from "./rollout";
import { type PropertiesPanel, propertiesPanel } from "./properties";
import { duplicateObject, removeObject, objectAt } from "./objects";
import { toolbar } from "./toolbar";
import { emptyDrawingMessage, type Tool } from "./tools";

export interface Editor {
  element: HTMLElement;
  scene: () => Scene;
  /** Opens another scene; undo restores the previous one. */
  open: (scene: Scene) => void;
  /** Call once the element is attached to the page. */
  start: () => void;
}

/** State of the editor. */
interface Session {
  state: EditorState;
  tool: Tool;
  /** Whether drawn objects are bodies. */
  moving: boolean;
  /** Whether a drag is in progress. */
  dragging: boolean;
  /** Whether the scene was just opened: its first problem is then selected. */
  justOpened: boolean;
}

/** Changes the state and updates the display. */
interface Actions {
  update: (state: EditorState) => void;
  render: () => void;
  select: (place: string) => void;
  choose: (tool: Tool) => void;
  /** Simulates the draft. */
  run: () => void;
  /** Announces a text to screen readers; with `visible` it is also displayed until the next change. */
  announce: (text: string, visible?: boolean) => void;
}

/** The draft with its history, kept while the page is open, so that returning from Play loses nothing. */
let lastState: EditorState | null = null;

/** The editor of a scene; `null` for this tab's draft. */
export function sceneEditor(first: Scene | null, library: Library, context: Context): Editor {
  const { signal } = context;
  const session: Session = { state: first ? initialState(first) : (lastState ?? initialState(storedDraft() ?? empty())), tool: "select", moving: true, dragging: false, justOpened: true };
  const at = canvas(LABEL, currentScene(session.state), signal);
  const objects = objectList((place) => editing.select(place));
  const problem = h("div", { class: "problem", role: "alert", hidden: true });
  const render = (): void => {
    const { state, tool, moving } = session;
    const invalid = state.problem && locationOf(state.problem.field);
    at.show({ scene: displayedScene(state), selected: state.selected, invalidName: (invalid && objectAt(currentScene(state), invalid)?.name) ?? null });
    objects.show(currentScene(state), state.selected, invalid);
    form.show(state);
    bar.show(tool, moving, state.history.past.length > 0, state.history.future.length > 0);
    showProblem(problem, state, editing.select, form);
    at.svg.dataset.tool = tool;
  };
  const update = (state: EditorState): void => {
    session.state = lastState = state;
    storeDraft(currentScene(state));
    render();
    film.changed();
  };
  const select = (place: string): void => {
    if (place === session.state.selected) return;
    session.state = endGesture({ ...session.state, selected: place });
    render();
    context.say(`${nameAt(session.state, place)} is selected.`);
  };
  const choose = (tool: Tool): void => {
    corners.drop();
    session.tool = tool;
    if (tool !== "box") session.moving = tool !== "segment";
    render();
    if (tool !== "select") at.svg.focus({ preventScroll: true });
  };
  const announce = (text: string, visible = false): void => {
    context.say(text);
    if (visible) bar.showMessage(text);
  };
  const editing: Actions = { update, render, select, choose, run: () => film.changed(), announce: announce };
  const form = propertiesPanel({ scene: () => currentScene(session.state), change: (next, key) => update(applyChange(session.state, next, key)), select, library });
  const undo = (): void => update(undoChange(session.state));
  const redo = (): void => update(redoChange(session.state));
  const bar = toolbar({ tool: choose, moving: (moving) => (session.moving = moving), undo: undo, redo: redo, zoom: at.zoom, fit: at.fit });
  const pointerActions = editorActions(session, editing);
  const corners = pointerInput(at, pointerActions, signal);
  keys(at, pointerActions, corners, commands(session, editing, pointerActions, form, at), signal);
  const film = rollout(at, () => session.state, () => session.dragging, rolloutListener(session, editing), context);
  shortcuts(undo, redo, signal);
  const stage = h("div", { class: "stage" }, bar.element, bar.hint, at.svg, problem, film.element, help());
  const side = h("div", { class: "stack" }, h("section", { class: "card", "aria-label": "Objects" }, objects.element), form.element);
  return {
    element: h("div", { class: "make-body" }, stage, side),
    scene: () => currentScene(session.state),
    open: (next) => {
      session.justOpened = true;
      update({ ...applyChange(endGesture(session.state), next, null), selected: "world", action: null });
      at.fit();
    },
    start: () => {
      render();
      at.fit();
      film.changed();
    },
  };
}

const LABEL = "The scene. Arrow keys move the selection, N selects the next object, Enter opens its properties or draws with the selected tool, letters select tools.";

/** Actions of mouse and keyboard on the draft. */
function editorActions(session: Session, editing: Actions): EditorActions {
  return {
    scene: () => displayedScene(session.state),
    sceneWithDisplayedPose: (place) => withDisplayedPose(session.state, place),
    selected: () => session.state.selected,
    tool: () => session.tool,
    moving: () => session.moving,
    select: editing.select,
    change: (next, key) => {
      session.dragging = key.startsWith("drag-");
      editing.update(stood(session.state, next, key));
    },
    onDrawn: (done) => {
      if (!done) return editing.announce(emptyDrawingMessage(currentScene(session.state), session.tool), true);
      editing.update({ ...applyChange(endGesture(session.state), done.scene, null), selected: done.place });
      editing.choose("select");
      editing.announce(`${nameAt(session.state, done.place)} was drawn.`);
    },
    onEnd: () => {
      if (!session.dragging) return;
      session.dragging = false;
      session.state = endGesture(session.state);
      editing.run();
    },
  };
}

function commands(session: Session, editing: Actions, pointerActions: EditorActions, form: PropertiesPanel, at: Canvas): Commands {
  const hasObject = (): boolean => objectAt(currentScene(session.state), session.state.selected) !== null;
  return {
    tool: editing.choose,
    remove: () => {
      if (hasObject()) editing.update({ ...applyChange(session.state, removeObject(currentScene(session.state), session.state.selected), null), selected: "world" });
    },
    duplicate: () => {
      if (hasObject()) pointerActions.onDrawn(duplicateObject(withDisplayedPose(session.state, session.state.selected), session.state.selected, 10 * at.step()));
    },
    form: form.focus,
  };
}

/** Applies results of a rollout to the draft. */
function rolloutListener(session: Session, editing: Actions): RolloutListener {
  return {
    onProblem: (invalid, of) => {
      // Problems of an earlier scene do not apply to this one.
      const justOpened = session.justOpened && of === currentScene(session.state);
      if (justOpened) session.justOpened = false;
      if (!invalid && !session.state.problem) return;
      // After opening a scene, select its first problem; while the user is drawing, keep the selection.
      const selected = invalid && justOpened ? locationOf(invalid.field) : session.state.selected;
      session.state = { ...session.state, problem: invalid, selected };
      editing.render();
    },
    onAction: (action) => {
      // The action belongs to a scene with other components.
      if (action && action.length !== currentScene(session.state).action?.components.length) return;
      session.state = { ...session.state, action };
      editing.render();
    },
  };
}

/** Displays the problem with a button that selects its field; unchanged problems are not announced again. */
function showProblem(problem: HTMLElement, state: EditorState, select: (place: string) => void, form: PropertiesPanel): void {
  const { problem: invalid } = state;
  const text = invalid ? `${invalid.field} ${invalid.message}` : "";
  if (problem.dataset.said === text) return;
  problem.dataset.said = text;
  problem.hidden = invalid === null;
  if (!invalid) return void put(problem);
  const place = locationOf(invalid.field);
  const go = h("button", { type: "button" }, `Go to ${nameAt(state, place)}`);
  go.addEventListener("click", () => (select(place), form.focus()));
  put(problem, h("p", {}, invalid.message), go);
}

function nameAt(state: EditorState, place: string): string {
  return objectAt(currentScene(state), place)?.name ?? place;
}

function help(): HTMLElement {
  const rows = KEYBOARD_HELP.flatMap(([key, description]) => [h("dt", {}, key), h("dd", {}, description)]);
  return h("details", {}, h("summary", {}, "Keyboard shortcuts"), h("dl", { class: "facts" }, ...rows));
}

/** Undo and redo shortcuts; input fields have their own. */
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
