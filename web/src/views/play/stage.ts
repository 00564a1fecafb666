// The stage: films over the scene (simulated, real, compared), their outcomes, distances, legend and time.

import { h, put, s } from "../../dom";
import { player } from "../../parts/player";
import { applyAction } from "../../scene/action";
import type { Picture } from "../../scene/draw";
import { filmLength, type Film } from "../../scene/film";
import type { Box, Pose, Scene } from "../../scene/types";
import type { Viewport } from "../../scene/viewport";
import type { Context } from "../../view";
import type { ArrowScale } from "./arrows";
import { distanceFigure } from "./distance";
import { filmLayers } from "./filmLayers";
import { legend, type Visible } from "./legend";
import { outcomeRow, type Outcome } from "./outcome";
import { overlaySwitches } from "./overlays";
import { sceneView } from "./sceneView";
import { contactList } from "./trails";

const NOTHING: Outcome = { film: null, solved: null, reached: null };

export interface FilmStage {
  element: HTMLElement;
  picture: Picture;
  view: Viewport;
  /** The path of invalid positions. */
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

/** The content of the stage. */
interface State {
  simulated: Outcome;
  real: Outcome;
  compared: Film | null;
  /** Whether the simulation has effects. */
  extended: boolean;
  scales: ArrowScale[];
  /** Whether no film was shown yet. */
  fresh: boolean;
}

/** The stage of a scene; `box` is the fitted view. `controls` are displayed beside the overlay switches; without them nothing is
 * placed in it, and the pointer moves the view. */
export function filmStage(scene: Scene, label: string, context: Context, box?: Box, controls?: HTMLElement): FilmStage {
  const state: State = { simulated: NOTHING, real: NOTHING, compared: null, extended: false, scales: [], fresh: true };
  const canvases = sceneView(scene, label, box, controls !== undefined, () => (layers.scale(canvases.view.pixel()), pose(play.time())), context.signal);
  const { picture: drawing, view, second } = canvases;
  const shade = s("path", { class: "shade" });
  drawing.under.append(shade);
  const layers = filmLayers(scene, drawing);
  const [outcomes, key, overlay] = [outcomeRow(scene), legend(scene), overlaySwitches(() => draw())];
  const contacts = h("details", { hidden: true });
  const toReal = distanceFigure("Distance between simulation and reality", "gap", scene, (x) => play.seek(x));
  const toCompared = distanceFigure("Distance between the two simulations", "gap-simulated", scene, (x) => play.seek(x));
  const pose = (time: number): void => {
    layers.pose(time, view.pixel());
    second.pose(time);
    for (const figure of [toReal, toCompared]) figure.at(time);
  };
  const play = player(pose, context.signal);
  const describe = (): void => {
    outcomes.show(state.simulated, state.real);
    const now = visible(state, Boolean(shade.getAttribute("d")), overlay.overlays.impact);
    key.show(now);
    for (const { classList } of [drawing.svg, key.element]) {
      classList.toggle("worlds", now.worlds);
      classList.toggle("extended", now.extended);
    }
  };
  const draw = (): void => {
    const [simulated, real, { compared }] = [state.simulated.film, state.real.film, state];
    state.scales = layers.load({ simulated, real, compared }, overlay.overlays, view.pixel());
    put(contacts, ...contactList(simulated?.contacts ?? []));
    contacts.hidden = !simulated?.contacts.length;
    toReal.show(simulated, real);
    toCompared.show(simulated, compared);
    play.load(Math.max(0, ...[simulated, real, compared].map((film) => (film ? filmLength(film) : 0))));
    describe();
    drawing.svg.dataset.film = String(Number(drawing.svg.dataset.film ?? 0) + 1);
  };
  new MutationObserver(describe).observe(shade, { attributes: true });
  const controlRow = h("div", { class: "row stage-controls" }, overlay.element, controls ?? "");
  const element = h("div", { class: "films" }, outcomes.element, canvases.element, play.element, key.element, controlRow, toCompared.element, toReal.element, contacts);
  const place = (action: readonly number[], reason: string | null): void => {
    const placed = applyAction(scene, action);
    drawing.redraw(placed);
    second.redraw(placed);
    layers.poseOthers(play.time());
    if (reason) drawing.pose("refused", starts(placed));
  };
  return { element, picture: drawing, view, shade, place, restart: play.restart, ...changes(state, canvases, draw, describe) };
}

/** The functions that change the films of a stage. */
function changes(state: State, { second, fitTo }: ReturnType<typeof sceneView>, draw: () => void, describe: () => void): Pick<FilmStage, "simulated" | "reached" | "real" | "compared"> {
  // The view follows the first film only, so that it is still while an object is dragged.
  const fit = (follow: boolean): void => fitTo([state.simulated.film, state.compared], follow);
  return {
    simulated: (film, solved, effects = false) => {
      [state.simulated, state.extended] = [{ film, solved, reached: null }, effects];
      if (film) {
        fit(state.fresh);
        state.fresh = false;
      }
      draw();
    },
    reached: (time) => {
      state.simulated = { ...state.simulated, reached: time };
      describe();
    },
    real: (film, solved) => {
      // A film of the real world ends when the goal is reached.
      state.real = { film, solved, reached: film && solved ? filmLength(film) : null };
      draw();
    },
    compared: (title, film) => {
      const before = state.compared;
      if (!film && !before) return;
      state.compared = film;
      second.show(film ? title : null, film);
      fit(before === null);
      draw();
    },
  };
}

function visible({ simulated, real, compared, extended, scales }: State, forbidden: boolean, impact: boolean): Visible {
  const films = { simulated: simulated.film !== null, real: real.film !== null, compared: compared !== null };
  const contacts = Boolean(simulated.film?.contacts.length);
  return { ...films, forbidden, contacts, impact, worlds: films.real || films.compared, extended: extended || films.compared, scales };
}

function starts(scene: Scene): Map<string, Pose> {
  const placed = scene.bodies.filter((b) => b.position && scene.action?.components.some((c) => c.target === b.name));
  return new Map(placed.map((b) => [b.name, { x: b.position![0], y: b.position![1], angle: b.angle ?? 0 }]));
}
