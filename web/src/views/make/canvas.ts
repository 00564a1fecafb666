// The picture: visible part of the world, grid, film over the drawing, handles.

import { put, s, set } from "../../dom";
import { ticks } from "../../parts/timePlot";
import { colours } from "../../scene/colour";
import { line, picture, type Picture } from "../../scene/draw";
import { posesAt, filmLength, type Film, pathUntil } from "../../scene/film";
import { allObjects, type Box, type Point, type Scene } from "../../scene/types";
import { sceneExtent } from "../../scene/extent";
import { placementAreas, type Handle, handles } from "./handles";
import { objectAt } from "./objects";

/** Displayed content of a draft. */
export interface CanvasContent {
  /** The displayed scene, in which every body has a position. */
  scene: Scene;
  selected: string;
  /** Name of the object with a problem. */
  invalidName: string | null;
}

export interface Canvas {
  svg: SVGSVGElement;
  picture: Picture;
  /** Size of a pixel, m. */
  pixel: () => number;
  /** Spacing of the snap grid, m. */
  step: () => number;
  /** The nearest point of the snap grid. */
  snap: (p: Point) => Point;
  show: (content: CanvasContent) => void;
  /** The handle of the selection nearest to a point, within `radius` pixels. */
  handle: (p: Point, near: number) => string | null;
  /** Displays the preview of a gesture; without arguments removes it. */
  sketch: (...elements: SVGElement[]) => void;
  film: (film: Film | null) => void;
  /** Displays the film at a time, s. */
  time: (time: number) => void;
  /** Shows the whole scene. */
  fit: () => void;
  zoom: (factor: number) => void;
  /** Moves the view, m. */
  pan: (by: Point) => void;
}

/** Minimum distance of grid lines, and minimum spacing of the snap grid, px. */
const [MIN_GRID_SPACING_PX, MIN_SNAP_PX] = [56, 3];
/** Radius of a handle, and distance of the rotation handle, px. */
const [HANDLE_RADIUS_PX, TURN_HANDLE_GAP_PX] = [7, 26];
/** Margin around the whole scene, share of its size. */
const FIT_MARGIN = 0.08;
/** Minimum and maximum width of the view, m. */
const [MIN_WIDTH_M, MAX_WIDTH_M] = [1e-3, 1e5];

export function canvas(label: string, first: Scene, signal: AbortSignal): Canvas {
  const drawing = picture(first, label, [-6, -1, 6, 7]);
  const { svg } = drawing;
  set(svg, { tabindex: 0, role: "application" });
  const [grid, places, trails, tools, labelsGroup] = [s("path", { class: "grid" }), s("g"), s("g"), s("g", { class: "handles" }), s("g", { class: "words" })];
  const preview = s("g", { class: "sketch" });
  svg.querySelector("g")!.prepend(grid);
  drawing.under.append(places);
  drawing.over.append(trails, preview, tools);
  svg.append(labelsGroup);
  let content: CanvasContent = { scene: first, selected: "world", invalidName: null };
  let [film, time, view, requestedBox, aspect]: [Film | null, number, Box, Box, number] = [null, 0, drawing.box, drawing.box, 1.5];
  const pixel = (): number => (view[2] - view[0]) / Math.max(1, svg.clientWidth);
  const step = (): number => roundLength(pixel() * MIN_SNAP_PX);
  const ghosts = (): void => drawing.pose("ghost", film ? posesAt(film, time) : new Map());
  const overlay = (): void => {
    put(places, ...placementAreas(content.scene).map(({ box, bounds }) => rectangleElement(box, bounds ? "bounds" : "area")));
    put(tools, ...handleElements(content, pixel()));
    put(labelsGroup, ...labels(view, pixel()), ...placementAreas(content.scene).map((a) => areaLabel(a, pixel())));
    highlight(svg, content);
  };
  const draw = (): void => {
    drawing.redraw(content.scene);
    ghosts();
    overlay();
  };
  const look = (box: Box): void => {
    requestedBox = box;
    view = withAspect(requestedBox, aspect);
    drawing.frame(view);
    set(grid, { d: lines(view, spacing(view, pixel())) });
    draw();
  };
  const resized = new ResizeObserver(() => {
    if (!svg.clientWidth || !svg.clientHeight) return;
    aspect = svg.clientWidth / svg.clientHeight;
    look(requestedBox);
  });
  resized.observe(svg);
  signal.addEventListener("abort", () => resized.disconnect());
  return {
    svg,
    picture: drawing,
    pixel,
    step,
    snap: (p) => [snapped(p[0], step()), snapped(p[1], step())],
    show: (now) => {
      content = now;
      draw();
    },
    handle: (p, near) => {
      const far = (h: Handle): number => Math.hypot(h.at[0] - p[0], h.at[1] - p[1]);
      const [first] = handles(content.scene, content.selected, TURN_HANDLE_GAP_PX * pixel()).sort((a, b) => far(a) - far(b));
      return first && far(first) <= near * pixel() ? first.id : null;
    },
    sketch: (...elements) => void put(preview, ...elements),
    film: (now) => {
      film = now;
      put(trails, ...(film ? trajectories(film, content.scene) : []));
      ghosts();
      svg.dataset.film = String(Number(svg.dataset.film ?? 0) + 1);
    },
    time: (now) => {
      time = now;
      ghosts();
    },
    fit: () => look(fitBox(content.scene)),
    zoom: (factor) => {
      const [x, y] = [(view[0] + view[2]) / 2, (view[1] + view[3]) / 2];
      const [w, h] = [((view[2] - view[0]) / 2) * factor, ((view[3] - view[1]) / 2) * factor];
      if (2 * w > MIN_WIDTH_M && 2 * w < MAX_WIDTH_M) look([x - w, y - h, x + w, y + h]);
    },
    pan: ([x, y]) => look([view[0] + x, view[1] + y, view[2] + x, view[3] + y]),
  };
}

/** A rectangle outline, m; also used for previews. */
export function rectangleElement([left, bottom, right, top]: Box, look: string): SVGRectElement {
  return s("rect", { class: look, x: left, y: bottom, width: Math.max(0, right - left), height: Math.max(0, top - bottom), "vector-effect": "non-scaling-stroke" });
}

/** The trajectories of all bodies. */
function trajectories(film: Film, scene: Scene): SVGElement[] {
  const bodyColours = colours(scene);
  return Object.keys(film.bodies).map((name) => line(pathUntil(film, name, filmLength(film)), { class: "trail", stroke: bodyColours.get(name) ?? "currentColor" }));
}

/** Handles of the selection. */
function handleElements({ scene, selected }: CanvasContent, pixel: number): SVGElement[] {
  return handles(scene, selected, TURN_HANDLE_GAP_PX * pixel).map(({ id, look, at: [x, y], about }) => {
    const place = { cx: x, cy: y, r: HANDLE_RADIUS_PX * pixel, "vector-effect": "non-scaling-stroke" };
    return s("circle", { class: `handle ${look}`, "data-handle": id, ...place }, s("title", {}, about));
  });
}

/** Highlights the selection and the object with a problem. */
function highlight(svg: SVGSVGElement, { scene, selected, invalidName: invalidName }: CanvasContent): void {
  const selectedName = objectAt(scene, selected)?.name;
  for (const group of svg.querySelectorAll<SVGGElement>("[data-name]")) {
    group.classList.toggle("selected", group.dataset.name === selectedName);
    group.classList.toggle("bad", group.dataset.name === invalidName);
  }
  svg.classList.toggle("goal-selected", selected === "goal");
}

/** The box of the whole scene with a margin; a default for an empty scene. */
function fitBox(scene: Scene): Box {
  const rooms = placementAreas(scene).flatMap(({ box }): Point[] => [[box[0], box[1]], [box[2], box[3]]]);
  const fixed = scene.bodies.some((b) => b.position) || rooms.length ? [] : allObjects(scene).map((b): Point => b.position ?? [0, 0]);
  if (!allObjects(scene).length && !rooms.length) return [-6, -1, 6, 7];
  const box = sceneExtent(scene, [...rooms, ...fixed]);
  const room = FIT_MARGIN * Math.max(box[2] - box[0], box[3] - box[1]);
  return [box[0] - room, box[1] - room, box[2] + room, box[3] + room];
}

/** A box enlarged to an aspect ratio. */
function withAspect(box: Box, aspect: number): Box {
  const [x, y] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const w = Math.max(box[2] - box[0], aspect * (box[3] - box[1])) / 2;
  return [x - w, y - w / aspect, x + w, y + w / aspect];
}

/** The next round number (1, 2, 5 times a power of ten) from a length, m. */
function roundLength(length: number): number {
  return ticks(length, 1)[1] ?? length;
}

function snapped(v: number, step: number): number {
  return Number((Math.round(v / step) * step).toPrecision(12));
}

function spacing(view: Box, pixel: number): number {
  return Math.max(roundLength(MIN_GRID_SPACING_PX * pixel), (view[2] - view[0]) / 100);
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

/** Axis labels in metres along the lower and left edges. */
function labels(view: Box, pixel: number): SVGElement[] {
  const step = spacing(view, pixel);
  const across = multiples(view[0] + 30 * pixel, view[2] - 30 * pixel, step).map((x) => word([x, view[1]], String(x), pixel, "middle"));
  const up = multiples(view[1] + 24 * pixel, view[3] - 24 * pixel, step).map((y) => word([view[0], y], String(y), pixel));
  return [...across, ...up, word([view[2] - 4 * pixel, view[1]], "m", pixel, "end")];
}

/** Label inside a rectangle: bounds and placement area often coincide. */
function areaLabel({ box, id, bounds }: { box: Box; id: string; bounds: boolean }, pixel: number): SVGElement {
  return bounds ? word([box[2] - 4 * pixel, box[1]], "bounds", pixel, "end") : word([box[0], box[3] - 18 * pixel], `area of ${id}`, pixel);
}

function word([x, y]: Point, text: string, pixel: number, anchor = "start"): SVGElement {
  return s("text", { x: x + (anchor === "start" ? 4 * pixel : 0), y: -y - 4 * pixel, "font-size": 12 * pixel, "text-anchor": anchor }, text);
}
