// Keyboard input in the picture: the same functions as the mouse.

import type { Body, Point, Scene } from "../../scene/types";
import { corners } from "../../scene/extent";
import type { Canvas } from "./canvas";
import type { PolygonDrawing, EditorActions } from "./pointer";
import { moveSelection } from "./handles";
import { write } from "./path";
import { distanceTo, middle, toWorldFrame, scaled } from "./shapes";
import { objectPaths, translated, objectAt, rotated } from "./objects";
import { type DrawingResult, type Tool, TOOLS, drawDefault } from "./tools";

/** Commands beyond those of the pointer. */
export interface Commands {
  tool: (tool: Tool) => void;
  remove: () => void;
  duplicate: () => void;
  /** Focuses the form of the selection. */
  form: () => void;
}

/** Keyboard help, for screen readers and the help text. */
export const KEYBOARD_HELP: readonly [string, string][] = [
  ["arrows", "move the selection; with Shift in small steps"],
  ["+ and -", "larger, smaller"],
  ["r and R", "rotate counter-clockwise, clockwise"],
  ["n and N", "next, previous object"],
  ["Enter", "draw in the middle of the view; with Select, open the properties"],
  ["Delete", "delete the selection"],
  ["Ctrl D", "duplicate the selection"],
  ["Ctrl Z, Ctrl Shift Z", "undo, redo"],
  [TOOLS.map((t) => t.key).join(" "), `tools: ${TOOLS.map((t) => t.title.toLowerCase()).join(", ")}`],
  ["0, i, o", "show all, zoom in, zoom out"],
  ["Escape", "cancel drawing; clear the selection"],
];

/** Step of an arrow key, share of the view; scale factor; rotation step, rad. */
const [MOVE_SHARE, SCALE_FACTOR, TURN_STEP_RAD] = [0.02, 1.1, Math.PI / 36];

export function keys(at: Canvas, actions: EditorActions, polygon: PolygonDrawing, commands: Commands, signal: AbortSignal): void {
  at.svg.addEventListener("keydown", (event) => {
    if (event.altKey || ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() !== "d")) return;
    const act = action(event, at, actions, polygon, commands);
    if (!act) return;
    event.preventDefault();
    act();
  }, { signal });
}

function action(event: KeyboardEvent, at: Canvas, actions: EditorActions, polygon: PolygonDrawing, commands: Commands): (() => void) | null {
  const { key } = event;
  if (event.ctrlKey || event.metaKey) return commands.duplicate;
  const direction = ARROWS[key];
  if (direction) return () => move(direction, event.shiftKey, at, actions);
  if (key === "+" || key === "-") return () => editSelected(actions, "size", (object) => ({ ...object, shape: scaled(object.shape, key === "+" ? SCALE_FACTOR : 1 / SCALE_FACTOR) }));
  if (key === "r" || key === "R") return () => editSelected(actions, "turn", (object) => rotated(object, (object.angle ?? 0) + (key === "r" ? TURN_STEP_RAD : -TURN_STEP_RAD)));
  if (key === "n" || key === "N") return () => next(actions, key === "n" ? 1 : -1);
  if (key === "Delete" || key === "Backspace") return commands.remove;
  if (key === "0") return at.fit;
  if (key === "i" || key === "o") return () => at.zoom(key === "i" ? 1 / 1.25 : 1.25);
  if (key === "Enter") return () => enter(at, actions, polygon, commands);
  if (key === "Escape") return () => escape(actions, polygon, commands);
  const tool = TOOLS.find((t) => t.key === key);
  return tool ? () => commands.tool(tool.tool) : null;
}

const ARROWS: Record<string, Point> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function move(direction: Point, fine: boolean, at: Canvas, actions: EditorActions): void {
  const place = actions.selected();
  if (place === "world") return;
  const step = fine ? at.step() : Math.max(1, Math.round(((at.picture.box[2] - at.picture.box[0]) * MOVE_SHARE) / at.step())) * at.step();
  const by: Point = [direction[0] * step, direction[1] * step];
  actions.change(moveSelection(actions.sceneWithDisplayedPose(place), place, by), `move-${place}`);
}

function editSelected(actions: EditorActions, what: string, make: (object: Body) => Body): void {
  const place = actions.selected();
  const scene: Scene = actions.sceneWithDisplayedPose(place);
  const one = objectAt(scene, place);
  if (one) actions.change(write(scene, place, make(one)), `${what}-${place}`);
}

function next(actions: EditorActions, by: number): void {
  const all = objectPaths(actions.scene());
  const now = all.indexOf(actions.selected());
  const place = all[now < 0 ? (by > 0 ? 0 : all.length - 1) : (now + by + all.length) % all.length];
  if (place) actions.select(place);
}

function enter(at: Canvas, actions: EditorActions, polygon: PolygonDrawing, commands: Commands): void {
  const tool = actions.tool();
  if (tool === "select") return commands.form();
  if (polygon.count()) return polygon.close();
  const box = at.picture.box;
  const middle = at.snap([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]);
  const result = drawDefault(actions.sceneWithDisplayedPose(""), tool, middle, actions.moving(), box, actions.selected(), at.step());
  actions.onDrawn(result && toFreePlace(result, 10 * at.step()));
}

function escape(actions: EditorActions, polygon: PolygonDrawing, commands: Commands): void {
  if (polygon.count()) return polygon.drop();
  if (actions.tool() !== "select") return commands.tool("select");
  actions.select("world");
}

/** Moves a new object upwards to a free place. */
function toFreePlace(result: DrawingResult, step: number): DrawingResult {
  const object = objectAt(result.scene, result.place);
  if (!object) return result;
  const others = objectPaths(result.scene).filter((p) => p !== result.place).map((p) => objectAt(result.scene, p)!);
  let now = object;
  for (let i = 0; i < MAX_STEPS_UP && others.some((other) => overlap(now, other)); i++) now = translated(now, [0, step]);
  return { ...result, scene: write(result.scene, result.place, now) };
}

/** Maximum number of steps to a free place. */
const MAX_STEPS_UP = 200;

/** Whether two objects may overlap: a corner of one lies in the other. */
function overlap(a: Body, b: Body): boolean {
  const hasCornerIn = (object: Body, other: Body): boolean =>
    [toWorldFrame(object, middle(object.shape)), ...corners(object.shape, object.position ?? [0, 0], object.angle ?? 0)].some((p) => distanceTo(other, p) === 0);
  return hasCornerIn(a, b) || hasCornerIn(b, a);
}
