// The picture that is drawn in: what is seen of the world, a grid to measure by, the film over the drawing, handles.

import { put, s, set } from "../../dom";
import { ticks } from "../../parts/timePlot";
import { colours } from "../../scene/colour";
import { line, picture, type Picture } from "../../scene/draw";
import { posesAt, filmLength, type Film, pathUntil } from "../../scene/film";
import { allObjects, type Box, type Point, type Scene } from "../../scene/types";
import { sceneExtent } from "../../scene/extent";
import { areas, type Handle, handles } from "./handles";
import { thing } from "./things";

/** What is shown of a draft. */
export interface Shown {
  /** The scene as it is drawn, every body somewhere. */
  scene: Scene;
  selected: string;
  /** Name of the thing that the server complains about. */
  bad: string | null;
}

export interface Canvas {
  svg: SVGSVGElement;
  picture: Picture;
  /** m that a pixel shows. */
  pixel: () => number;
  /** Grid that the mouse keeps to, m. */
  step: () => number;
  /** The nearest point of that grid. */
  snap: (p: Point) => Point;
  show: (shown: Shown) => void;
  /** The handle of what is selected that is nearest to a point, within so many pixels. */
  handle: (p: Point, near: number) => string | null;
  /** What a gesture would draw; nothing where none is under way. */
  sketch: (...elements: SVGElement[]) => void;
  film: (film: Film | null) => void;
  /** The film at a time, s. */
  time: (time: number) => void;
  /** Shows everything of the scene. */
  fit: () => void;
  zoom: (factor: number) => void;
  /** Moves what is seen, m. */
  pan: (by: Point) => void;
}

/** Pixels: between two lines of the grid at least, and the grid of the mouse at least. */
const [LINES, SNAP] = [56, 3];
/** Radius of a handle, and how far the turning one stands off, pixels. */
const [HANDLE, OFF] = [7, 26];
/** Room around the scene when all of it is shown, share of its size. */
const ROOM = 0.08;
/** Widths of the world that can be shown, m. */
const [NARROW, WIDE] = [1e-3, 1e5];

export function canvas(label: string, first: Scene, signal: AbortSignal): Canvas {
  const made = picture(first, label, [-6, -1, 6, 7]);
  const { svg } = made;
  set(svg, { tabindex: 0, role: "application" });
  const [grid, places, trails, tools, words] = [s("path", { class: "grid" }), s("g"), s("g"), s("g", { class: "handles" }), s("g", { class: "words" })];
  const preview = s("g", { class: "sketch" });
  svg.querySelector("g")!.prepend(grid);
  made.under.append(places);
  made.over.append(trails, preview, tools);
  svg.append(words);
  let shown: Shown = { scene: first, selected: "world", bad: null };
  let [film, time, view, wanted, aspect]: [Film | null, number, Box, Box, number] = [null, 0, made.box, made.box, 1.5];
  const pixel = (): number => (view[2] - view[0]) / Math.max(1, svg.clientWidth);
  const step = (): number => grade(pixel() * SNAP);
  const ghosts = (): void => made.pose("ghost", film ? posesAt(film, time) : new Map());
  const overlay = (): void => {
    put(places, ...areas(shown.scene).map(({ box, bounds }) => outlined(box, bounds ? "bounds" : "area")));
    put(tools, ...grips(shown, pixel()));
    put(words, ...labels(view, pixel()), ...areas(shown.scene).map((a) => named(a, pixel())));
    highlighted(svg, shown);
  };
  const draw = (): void => {
    made.redraw(shown.scene);
    ghosts();
    overlay();
  };
  const look = (box: Box): void => {
    wanted = box;
    view = shaped(wanted, aspect);
    made.frame(view);
    set(grid, { d: lines(view, spacing(view, pixel())) });
    draw();
  };
  const resized = new ResizeObserver(() => {
    if (!svg.clientWidth || !svg.clientHeight) return;
    aspect = svg.clientWidth / svg.clientHeight;
    look(wanted);
  });
  resized.observe(svg);
  signal.addEventListener("abort", () => resized.disconnect());
  return {
    svg,
    picture: made,
    pixel,
    step,
    snap: (p) => [gridded(p[0], step()), gridded(p[1], step())],
    show: (now) => {
      shown = now;
      draw();
    },
    handle: (p, near) => {
      const far = (h: Handle): number => Math.hypot(h.at[0] - p[0], h.at[1] - p[1]);
      const [first] = handles(shown.scene, shown.selected, OFF * pixel()).sort((a, b) => far(a) - far(b));
      return first && far(first) <= near * pixel() ? first.id : null;
    },
    sketch: (...elements) => void put(preview, ...elements),
    film: (now) => {
      film = now;
      put(trails, ...(film ? tracks(film, shown.scene) : []));
      ghosts();
      svg.dataset.film = String(Number(svg.dataset.film ?? 0) + 1);
    },
    time: (now) => {
      time = now;
      ghosts();
    },
    fit: () => look(whole(shown.scene)),
    zoom: (factor) => {
      const [x, y] = [(view[0] + view[2]) / 2, (view[1] + view[3]) / 2];
      const [w, h] = [((view[2] - view[0]) / 2) * factor, ((view[3] - view[1]) / 2) * factor];
      if (2 * w > NARROW && 2 * w < WIDE) look([x - w, y - h, x + w, y + h]);
    },
    pan: ([x, y]) => look([view[0] + x, view[1] + y, view[2] + x, view[3] + y]),
  };
}

/** A box with a frame, m; drawn while something is being drawn, too. */
export function outlined([left, bottom, right, top]: Box, look: string): SVGRectElement {
  return s("rect", { class: look, x: left, y: bottom, width: Math.max(0, right - left), height: Math.max(0, top - bottom), "vector-effect": "non-scaling-stroke" });
}

/** The ways of all bodies. */
function tracks(film: Film, scene: Scene): SVGElement[] {
  const dealt = colours(scene);
  return Object.keys(film.bodies).map((name) => line(pathUntil(film, name, filmLength(film)), { class: "trail", stroke: dealt.get(name) ?? "currentColor" }));
}

/** Handles of what is selected. */
function grips({ scene, selected }: Shown, pixel: number): SVGElement[] {
  return handles(scene, selected, OFF * pixel).map(({ id, look, at: [x, y], about }) => {
    const place = { cx: x, cy: y, r: HANDLE * pixel, "vector-effect": "non-scaling-stroke" };
    return s("circle", { class: `handle ${look}`, "data-handle": id, ...place }, s("title", {}, about));
  });
}

/** Marks what is selected, and what is wrong. */
function highlighted(svg: SVGSVGElement, { scene, selected, bad }: Shown): void {
  const chosen = thing(scene, selected)?.name;
  for (const group of svg.querySelectorAll<SVGGElement>("[data-name]")) {
    group.classList.toggle("selected", group.dataset.name === chosen);
    group.classList.toggle("bad", group.dataset.name === bad);
  }
  svg.classList.toggle("goal-selected", selected === "goal");
}

/** Everything of a scene with some room; of one with nothing in it a few metres. */
function whole(scene: Scene): Box {
  const rooms = areas(scene).flatMap(({ box }): Point[] => [[box[0], box[1]], [box[2], box[3]]]);
  const fixed = scene.bodies.some((b) => b.position) || rooms.length ? [] : allObjects(scene).map((b): Point => b.position ?? [0, 0]);
  if (!allObjects(scene).length && !rooms.length) return [-6, -1, 6, 7];
  const box = sceneExtent(scene, [...rooms, ...fixed]);
  const room = ROOM * Math.max(box[2] - box[0], box[3] - box[1]);
  return [box[0] - room, box[1] - room, box[2] + room, box[3] + room];
}

/** A box widened to an aspect. */
function shaped(box: Box, aspect: number): Box {
  const [x, y] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const w = Math.max(box[2] - box[0], aspect * (box[3] - box[1])) / 2;
  return [x - w, y - w / aspect, x + w, y + w / aspect];
}

/** The round number (1, 2, 5 times a power of ten) that is next from a length, m. */
function grade(length: number): number {
  return ticks(length, 1)[1] ?? length;
}

function gridded(v: number, step: number): number {
  return Number((Math.round(v / step) * step).toPrecision(12));
}

function spacing(view: Box, pixel: number): number {
  return Math.max(grade(LINES * pixel), (view[2] - view[0]) / 100);
}

function multiples(from: number, to: number, step: number): number[] {
  const first = Math.ceil(from / step);
  return Array.from({ length: Math.max(0, Math.floor(to / step) - first + 1) }, (_, i) => Number(((first + i) * step).toPrecision(12)));
}

function lines(view: Box, step: number): string {
  const columns = multiples(view[0], view[2], step).map((x) => `M${x} ${view[1]}V${view[3]}`);
  const rows = multiples(view[1], view[3], step).map((y) => `M${view[0]} ${y}H${view[2]}`);
  return [...columns, ...rows].join("");
}

/** Metres along the lower and the left edge. */
function labels(view: Box, pixel: number): SVGElement[] {
  const step = spacing(view, pixel);
  const across = multiples(view[0] + 30 * pixel, view[2] - 30 * pixel, step).map((x) => word([x, view[1]], String(x), pixel, "middle"));
  const up = multiples(view[1] + 24 * pixel, view[3] - 24 * pixel, step).map((y) => word([view[0], y], String(y), pixel));
  return [...across, ...up, word([view[2] - 4 * pixel, view[1]], "m", pixel, "end")];
}

/** What a rectangle is, inside it: bounds and the place of a thing are often the same. */
function named({ box, id, bounds }: { box: Box; id: string; bounds: boolean }, pixel: number): SVGElement {
  return bounds ? word([box[2] - 4 * pixel, box[1]], "bounds", pixel, "end") : word([box[0], box[3] - 18 * pixel], `place of ${id}`, pixel);
}

function word([x, y]: Point, text: string, pixel: number, anchor = "start"): SVGElement {
  return s("text", { x: x + (anchor === "start" ? 4 * pixel : 0), y: -y - 4 * pixel, "font-size": 12 * pixel, "text-anchor": anchor }, text);
}
