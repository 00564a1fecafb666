// The films over the scene: simulated, real and compared, with their distances and the controls of the view.

import { h, put, s, set } from "../../dom";
import { player } from "../../parts/player";
import { applyAction } from "../../scene/action";
import { colours } from "../../scene/colour";
import { picture, type Picture } from "../../scene/draw";
import { bodyThickness, pathCorners, sceneExtent } from "../../scene/extent";
import { filmLength, posesAt, type Film } from "../../scene/film";
import type { Box, Point, Pose, Scene } from "../../scene/types";
import { viewKeys, viewButtons, scaleBar, wheelInput } from "../../scene/viewControls";
import { viewport, type Viewport } from "../../scene/viewport";
import type { Context } from "../../view";
import { arrows, type ArrowScale } from "./arrows";
import { comparisonCanvas } from "./comparisonCanvas";
import { distanceFigure } from "./distance";
import { keysHelp } from "./keys";
import { legend } from "./legend";
import { outcomeRow, type Outcome } from "./outcome";
import { overlaySwitches } from "./overlays";
import { pointerInput } from "./pointer";
import { contactList, contactRings, dots, trails } from "./trails";

/** Time for which a contact is highlighted, s. */
const CONTACT_HIGHLIGHT_S = 0.2;
/** Range of the aspect ratio of the canvas. */
const [MIN_ASPECT, MAX_ASPECT] = [0.8, 2];
const NOTHING: Outcome = { film: null, solved: null, reached: null };

export interface FilmStage {
  element: HTMLElement;
  picture: Picture;
  view: Viewport;
  /** The path of invalid positions; call `redraw` after a change. */
  shade: SVGPathElement;
  /** Shows the initial state, without a film. */
  place: (action: readonly number[], reason: string | null) => void;
  /** `solved`: null if unknown; `extended`: whether it has effects. */
  simulated: (film: Film | null, solved: boolean | null, extended?: boolean) => void;
  /** The time at which the simulation reaches the goal, s. */
  reached: (time: number | null) => void;
  real: (film: Film | null, solved: boolean | null) => void;
  compared: (title: string, film: Film | null) => void;
  restart: () => void;
}

/** The stage of a scene; `box` is the fitted view. `controls` are displayed beside the overlay switches; without them nothing is
 * placed in it, and the pointer moves the view. */
export function filmStage(scene: Scene, label: string, context: Context, box?: Box, controls?: HTMLElement): FilmStage {
  const fitted = box ?? sceneExtent(scene, actionCorners(scene));
  const drawing = picture(scene, label, fitted);
  const marks = { trails: s("g"), dots: s("g"), rings: s("g") };
  const arrowLayer = arrows();
  const shade = s("path", { class: "shade" });
  drawing.under.append(shade);
  drawing.over.append(marks.trails, marks.dots, marks.rings, arrowLayer.group);
  let [simulated, real, compared, extended, fresh]: [Outcome, Outcome, Film | null, boolean, boolean] = [NOTHING, NOTHING, null, false, true];
  let [rings, scales]: [{ t: number; ring: SVGCircleElement }[], ArrowScale[]] = [[], []];
  const bar = scaleBar();
  const view = viewport(drawing, fitted, () => {
    bar.show(view.pixel());
    second.frame(view.box());
    drawMarks();
    drawTime(play.time());
  }, context.signal);
  const second = comparisonCanvas(scene, view);
  const [outcomes, key] = [outcomeRow(scene), legend(scene)];
  const overlay = overlaySwitches(() => draw());
  const contacts = h("details", { hidden: true });
  const toReal = distanceFigure("Distance between simulation and reality", "gap", scene, (x) => play.seek(x));
  const toCompared = distanceFigure("Distance between the two simulations", "gap-simulated", scene, (x) => play.seek(x));
  const drawTime = (time: number): void => {
    const at = (film: Film | null): Map<string, Pose> => (film ? posesAt(film, time) : new Map());
    if (simulated.film) drawing.pose("solid", at(simulated.film));
    drawing.pose("ghost", at(real.film));
    drawing.pose("other", at(compared));
    second.pose(at(compared));
    for (const { t, ring } of rings) ring.classList.toggle("lit", time >= t && time < t + CONTACT_HIGHLIGHT_S);
    arrowLayer.draw(time, view.pixel());
    for (const figure of [toReal, toCompared]) figure.at(time);
  };
  const drawMarks = (): void => {
    put(marks.dots, ...(real.film ? dots(real.film, view.pixel()) : []));
    rings = simulated.film ? contactRings(simulated.film, view.pixel(), overlay.overlays.impact) : [];
    put(marks.rings, ...rings.map((r) => r.ring));
  };
  const play = player(drawTime, context.signal);
  const describe = (): void => {
    outcomes.show(simulated, real);
    const forbidden = Boolean(shade.getAttribute("d"));
    const some = { simulated: Boolean(simulated.film), real: Boolean(real.film), compared: Boolean(compared) };
    const worlds = some.real || some.compared;
    key.show({ ...some, forbidden, contacts: rings.length > 0, impact: overlay.overlays.impact, worlds, extended: extended || some.compared, scales });
    for (const element of [drawing.svg, key.element]) {
      element.classList.toggle("worlds", worlds);
      element.classList.toggle("extended", extended || some.compared);
    }
  };
  const draw = (): void => {
    const colourOf = colours(scene);
    const path = (film: Film | null, look: string): SVGElement[] => (film ? trails(film, look, (name) => colourOf.get(name) ?? "currentColor") : []);
    put(marks.trails, ...path(compared, "trail other"), ...path(simulated.film, "trail"), ...path(real.film, "trail real"));
    scales = arrowLayer.load(simulated.film, overlay.overlays);
    drawMarks();
    const listed = simulated.film?.contacts ?? [];
    put(contacts, ...contactList(listed));
    contacts.hidden = !listed.length;
    toReal.show(simulated.film, real.film);
    toCompared.show(simulated.film, compared);
    play.load(Math.max(0, ...[simulated.film, real.film, compared].map((film) => (film ? filmLength(film) : 0))));
    describe();
    drawing.svg.dataset.film = String(Number(drawing.svg.dataset.film ?? 0) + 1);
  };
  const place = (action: readonly number[], reason: string | null): void => {
    const placed = applyAction(scene, action);
    drawing.redraw(placed);
    second.redraw(placed);
    if (reason) drawing.pose("refused", starts(placed));
    drawTime(play.time());
  };
  // Scenes without bounds are fitted to their films; the view follows the first film only, so that it is still while dragging.
  const fitToFilms = (follow: boolean): void => {
    if (box || scene.action?.bounds) return;
    const now = filmExtent(scene, [simulated.film, compared], fitted);
    if (follow) shape(now);
    view.fitTo(now, follow);
  };
  set(drawing.svg, { tabindex: 0, role: "application" });
  put(drawing.svg, s("title", {}, label), ...drawing.svg.childNodes);
  const shape = ([left, bottom, right, top]: Box): void => {
    const aspect = Math.min(MAX_ASPECT, Math.max(MIN_ASPECT, (right - left) / (top - bottom)));
    for (const svg of [drawing.svg, second.svg]) svg.style.aspectRatio = String(aspect);
  };
  shape(fitted);
  wheelInput(drawing, view);
  viewKeys(drawing.svg, view);
  if (!controls) pointerInput(drawing, view, null);
  new MutationObserver(describe).observe(shade, { attributes: true });
  const tools = h("div", { class: "canvas-tools" }, viewButtons(view), keysHelp());
  const canvas = h("div", { class: "stage canvas" }, drawing.svg, tools, bar.element, second.caption);
  const controlRow = h("div", { class: "row stage-controls" }, overlay.element, controls ?? "");
  return {
    element: h("div", { class: "films" }, outcomes.element, h("div", { class: "canvases" }, canvas, second.element), play.element, key.element, controlRow, toCompared.element, toReal.element, contacts),
    picture: drawing,
    view,
    shade,
    place,
    simulated: (film, solved, effects = false) => {
      [simulated, extended] = [{ film, solved, reached: null }, effects];
      if (film) {
        fitToFilms(fresh);
        fresh = false;
      }
      draw();
    },
    reached: (time) => {
      simulated = { ...simulated, reached: time };
      describe();
    },
    real: (film, solved) => {
      // A film of the real world ends when the goal is reached.
      real = { film, solved, reached: film && solved ? filmLength(film) : null };
      draw();
    },
    compared: (title, film) => {
      const begins = film !== null && compared === null;
      if (film === null && compared === null) return;
      compared = film;
      second.show(film ? title : null, film);
      fitToFilms(begins);
      draw();
    },
    restart: play.restart,
  };
}

/** Corners of the area in which an action places objects. */
function actionCorners(scene: Scene): Point[] {
  const components = scene.action?.components ?? [];
  return components.flatMap((x) => {
    const y = x.set === "x" ? components.find((c) => c.target === x.target && c.set === "y") : undefined;
    return y ? [[x.low, y.low], [x.high, y.high]] as Point[] : [];
  });
}

/** The extent of a scene with the films of its bodies. */
function filmExtent(scene: Scene, films: readonly (Film | null)[], near: Box): Box {
  const corners = films.flatMap((film) =>
    scene.bodies.flatMap((body) => {
      const track = film?.bodies[body.name];
      return track ? pathCorners(track.x.map((x, k): Point => [x, track.y[k]!]), bodyThickness(body) / 2, near) : [];
    }),
  );
  return sceneExtent(scene, [...actionCorners(scene), ...corners]);
}

function starts(scene: Scene): Map<string, Pose> {
  const placed = scene.bodies.filter((b) => b.position && scene.action?.components.some((c) => c.target === b.name));
  return new Map(placed.map((b) => [b.name, { x: b.position![0], y: b.position![1], angle: b.angle ?? 0 }]));
}
