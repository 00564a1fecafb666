// The keyboard in the picture: everything that the mouse does.

import type { Body, Point, Scene } from "../../scene/types";
import { corners } from "../../scene/extent";
import type { Canvas } from "./canvas";
import type { Corners, Hand } from "./gestures";
import { moved } from "./handles";
import { write } from "./path";
import { far, middle, outward, scaled } from "./shapes";
import { places, shifted, thing, turned } from "./things";
import { type Drawn, type Tool, TOOLS, usual } from "./tools";

/** What keys do beyond what the hand does. */
export interface Commands {
  tool: (tool: Tool) => void;
  remove: () => void;
  duplicate: () => void;
  /** To the form of what is selected. */
  form: () => void;
}

/** What the picture tells screen readers, and the help shows. */
export const HELP: readonly [string, string][] = [
  ["arrows", "move what is selected; with Shift finely"],
  ["+ and -", "larger, smaller"],
  ["r and R", "turn counter-clockwise, clockwise"],
  ["n and N", "next, previous thing"],
  ["Enter", "put what the tool draws in the middle; with Select, to the numbers"],
  ["Delete", "take it away"],
  ["Ctrl D", "the same again"],
  ["Ctrl Z, Ctrl Shift Z", "undo, redo"],
  [TOOLS.map((t) => t.key).join(" "), `tools: ${TOOLS.map((t) => t.title.toLowerCase()).join(", ")}`],
  ["0, i, o", "show all, nearer, farther"],
  ["Escape", "give up what is being drawn; nothing selected"],
];

/** How far an arrow moves, share of what is seen; how much larger, and how far round, rad. */
const [STEP, GROW, TURN] = [0.02, 1.1, Math.PI / 36];

export function keys(at: Canvas, hand: Hand, polygon: Corners, commands: Commands, signal: AbortSignal): void {
  at.svg.addEventListener("keydown", (event) => {
    if (event.altKey || ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() !== "d")) return;
    const act = action(event, at, hand, polygon, commands);
    if (!act) return;
    event.preventDefault();
    act();
  }, { signal });
}

function action(event: KeyboardEvent, at: Canvas, hand: Hand, polygon: Corners, commands: Commands): (() => void) | null {
  const { key } = event;
  if (event.ctrlKey || event.metaKey) return commands.duplicate;
  const way = ARROWS[key];
  if (way) return () => move(way, event.shiftKey, at, hand);
  if (key === "+" || key === "-") return () => edited(hand, "size", (one) => ({ ...one, shape: scaled(one.shape, key === "+" ? GROW : 1 / GROW) }));
  if (key === "r" || key === "R") return () => edited(hand, "turn", (one) => turned(one, (one.angle ?? 0) + (key === "r" ? TURN : -TURN)));
  if (key === "n" || key === "N") return () => next(hand, key === "n" ? 1 : -1);
  if (key === "Delete" || key === "Backspace") return commands.remove;
  if (key === "0") return at.fit;
  if (key === "i" || key === "o") return () => at.zoom(key === "i" ? 1 / 1.25 : 1.25);
  if (key === "Enter") return () => enter(at, hand, polygon, commands);
  if (key === "Escape") return () => escape(hand, polygon, commands);
  const tool = TOOLS.find((t) => t.key === key);
  return tool ? () => commands.tool(tool.tool) : null;
}

const ARROWS: Record<string, Point> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function move(way: Point, fine: boolean, at: Canvas, hand: Hand): void {
  const place = hand.selected();
  if (place === "world") return;
  const step = fine ? at.step() : Math.max(1, Math.round(((at.picture.box[2] - at.picture.box[0]) * STEP) / at.step())) * at.step();
  const by: Point = [way[0] * step, way[1] * step];
  hand.change(moved(hand.grounded(place), place, by), `move-${place}`);
}

function edited(hand: Hand, what: string, make: (one: Body) => Body): void {
  const place = hand.selected();
  const scene: Scene = hand.grounded(place);
  const one = thing(scene, place);
  if (one) hand.change(write(scene, place, make(one)), `${what}-${place}`);
}

function next(hand: Hand, by: number): void {
  const all = places(hand.scene());
  const now = all.indexOf(hand.selected());
  const place = all[now < 0 ? (by > 0 ? 0 : all.length - 1) : (now + by + all.length) % all.length];
  if (place) hand.select(place);
}

function enter(at: Canvas, hand: Hand, polygon: Corners, commands: Commands): void {
  const tool = hand.tool();
  if (tool === "select") return commands.form();
  if (polygon.count()) return polygon.close();
  const box = at.picture.box;
  const middle = at.snap([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]);
  const done = usual(hand.grounded(""), tool, middle, hand.moving(), box, hand.selected(), at.step());
  hand.drew(done && aside(done, 10 * at.step()));
}

function escape(hand: Hand, polygon: Corners, commands: Commands): void {
  if (polygon.count()) return polygon.drop();
  if (hand.tool() !== "select") return commands.tool("select");
  hand.select("world");
}

/** What was drawn, above what was there before. */
function aside(done: Drawn, step: number): Drawn {
  const one = thing(done.scene, done.place);
  if (!one) return done;
  const others = places(done.scene).filter((p) => p !== done.place).map((p) => thing(done.scene, p)!);
  let now = one;
  for (let i = 0; i < TRIES && others.some((other) => meet(now, other)); i++) now = shifted(now, [0, step]);
  return { ...done, scene: write(done.scene, done.place, now) };
}

/** Steps upwards for a free place. */
const TRIES = 200;

/** Whether two things may overlap: corners of one in the other. */
function meet(a: Body, b: Body): boolean {
  const reached = (one: Body, other: Body): boolean =>
    [outward(one, middle(one.shape)), ...corners(one.shape, one.position ?? [0, 0], one.angle ?? 0)].some((p) => far(other, p) === 0);
  return reached(a, b) || reached(b, a);
}
