// The film over the scene: bodies, trajectories, contacts, simulated and real, and their distance.

import { h, put, s, set } from "../../dom";
import { timePlot } from "../../parts/timePlot";
import { player } from "../../parts/player";
import { short } from "../../parts/slider";
import { colours } from "../../scene/colour";
import { line, picture, type Picture } from "../../scene/draw";
import { posesAt, type Contact, distanceOverTime, filmLength, type Film, pathUntil } from "../../scene/film";
import { applyAction } from "../../scene/action";
import type { Box, Point, Scene } from "../../scene/types";
import type { Context } from "../../view";

/** Radius of a contact ring, share of the picture's width; scaled by the impact speed. */
const CONTACT_RING_SHARE = 0.008;
/** Time for which a contact is highlighted, s. */
const CONTACT_HIGHLIGHT_S = 0.2;

export interface FilmStage {
  element: HTMLElement;
  picture: Picture;
  /** Shows the initial state, without a film. */
  place: (action: readonly number[], reason: string | null) => void;
  simulated: (film: Film | null, solved: boolean | null) => void;
  real: (film: Film | null, solved: boolean | null) => void;
  restart: () => void;
}

/** The stage of a scene. */
export function filmStage(scene: Scene, label: string, context: Context, box?: Box): FilmStage {
  const drawing = picture(scene, label, box);
  set(drawing.svg, { tabindex: 0, role: "application" });
  const trails = s("g");
  const rings = s("g");
  drawing.over.append(trails, rings);
  const films: { sim: Film | null; real: Film | null } = { sim: null, real: null };
  let contactRings: { t: number; ring: SVGCircleElement }[] = [];
  const distancePlot = timePlot({ about: "Distance between simulated and real, m over s", x: "s", y: "m apart" }, (x) => play.seek(x));
  const legend = scene.bodies.map((b) => h("span", { class: "key" }, key(colours(scene).get(b.name)!), b.name));
  const distanceFigure = h("figure", { class: "gap", hidden: true }, h("figcaption", { class: "row" }, "Distance between simulation and reality", ...legend), distancePlot.svg);
  const contacts = h("details", { hidden: true });
  const verdicts = h("div", { class: "row verdicts", role: "status" });
  const verdict: Record<"sim" | "real", string | null> = { sim: null, real: null };
  const play = player((time) => {
    if (films.sim) drawing.pose("solid", posesAt(films.sim, time));
    drawing.pose("ghost", films.real ? posesAt(films.real, time) : new Map());
    for (const { t, ring } of contactRings) ring.classList.toggle("lit", time >= t && time < t + CONTACT_HIGHLIGHT_S);
    distancePlot.at(time);
  }, context.signal);
  const draw = (): void => {
    const bodyColours = colours(scene);
    const width = drawing.box[2] - drawing.box[0];
    put(trails, ...(films.sim ? paths(films.sim, bodyColours, "trail") : []), ...(films.real ? [...paths(films.real, bodyColours, "trail real"), ...dots(films.real, bodyColours, width)] : []));
    contactRings = films.sim ? films.sim.contacts.flatMap((c) => contactRing(films.sim!, c, width)) : [];
    put(rings, ...contactRings.map((l) => l.ring));
    put(contacts, ...contactList(films.sim?.contacts ?? []));
    contacts.hidden = !films.sim?.contacts.length;
    distanceFigure.hidden = !(films.sim && films.real);
    if (films.sim && films.real) {
      const { t, bodies } = distanceOverTime(films.sim, films.real);
      const lines = [...bodies].map(([name, y]) => ({ name, colour: bodyColours.get(name) ?? "currentColor", x: t, y }));
      distancePlot.draw(lines, films.sim.contacts.map((c) => c.t));
    }
    play.load(Math.max(films.sim ? filmLength(films.sim) : 0, films.real ? filmLength(films.real) : 0));
    put(verdicts, badge("Simulation", "sim", verdict.sim), badge("Reality", "real", verdict.real));
    drawing.svg.dataset.film = String(Number(drawing.svg.dataset.film ?? 0) + 1);
  };
  const showFilm = (which: "sim" | "real") => (film: Film | null, solved: boolean | null): void => {
    films[which] = film;
    verdict[which] = film === null ? null : solved === null ? "no goal" : solved ? "solved" : "not solved";
    draw();
  };
  const place = (action: readonly number[], reason: string | null): void => {
    drawing.redraw(applyAction(scene, action));
    if (reason) drawing.pose("refused", starts(applyAction(scene, action)));
  };
  put(drawing.svg, s("title", {}, label), ...drawing.svg.childNodes);
  return {
    element: h("div", { class: "stage" }, drawing.svg, play.element, verdicts, distanceFigure, contacts),
    picture: drawing,
    place,
    simulated: showFilm("sim"),
    real: showFilm("real"),
    restart: play.restart,
  };
}

/** A legend line of a colour. */
function key(colour: string): SVGElement {
  return s("svg", { width: 18, height: 10, "aria-hidden": "true" }, s("line", { x1: 0, x2: 18, y1: 5, y2: 5, stroke: colour, "stroke-width": 3 }));
}

function starts(scene: Scene): Map<string, { x: number; y: number; angle: number }> {
  const placed = scene.bodies.filter((b) => b.position && scene.action?.components.some((c) => c.target === b.name));
  return new Map(placed.map((b) => [b.name, { x: b.position![0], y: b.position![1], angle: b.angle ?? 0 }]));
}

function paths(film: Film, bodyColours: Map<string, string>, look: string): SVGElement[] {
  return Object.keys(film.bodies).map((name) => line(pathUntil(film, name, filmLength(film)), { class: look, stroke: bodyColours.get(name) ?? "currentColor" }));
}

/** Observed positions of real bodies. */
function dots(film: Film, bodyColours: Map<string, string>, width: number): SVGElement[] {
  return Object.entries(film.bodies).flatMap(([name, track]) =>
    film.t.map((_, k) => s("circle", { class: "seen", cx: track.x[k]!, cy: track.y[k]!, r: width * 0.003, fill: bodyColours.get(name) ?? "currentColor" })),
  );
}

function contactRing(film: Film, contact: Contact, width: number): { t: number; ring: SVGCircleElement }[] {
  const poses = posesAt(film, contact.t);
  const points = contact.between.map((name) => poses.get(name)).filter((p) => p !== undefined);
  if (!points.length) return [];
  const [x, y]: Point = [points.reduce((sum, p) => sum + p.x, 0) / points.length, points.reduce((sum, p) => sum + p.y, 0) / points.length];
  const r = width * CONTACT_RING_SHARE * (0.5 + Math.min(2, Math.sqrt(contact.speed) / 3));
  return [{ t: contact.t, ring: s("circle", { class: "contact", cx: x, cy: y, r, "vector-effect": "non-scaling-stroke" }) }];
}

/** List of the first contacts. */
function contactList(contacts: readonly Contact[]): HTMLElement[] {
  const items = contacts.slice(0, 50).map((c) => h("li", {}, `${c.t.toFixed(2)} s: ${c.between.join(" and ")}, ${short(c.speed, "m/s")}`));
  return [h("summary", {}, contacts.length === 1 ? "1 contact in the simulation" : `${contacts.length} contacts in the simulation`), h("ol", {}, ...items)];
}

function badge(name: string, which: string, verdict: string | null): HTMLElement | null {
  if (verdict === null) return null;
  return h("span", { class: `badge ${which}`, "data-verdict": verdict }, `${name}: ${verdict}`);
}
