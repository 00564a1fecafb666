// Trajectories, measured positions and contact rings of films.

import { h, s, type Attributes } from "../../dom";
import { short } from "../../parts/slider";
import { line } from "../../scene/draw";
import { filmLength, pathUntil, posesAt, type Contact, type Film } from "../../scene/film";

/** Radius of a measured position, of a contact ring, and of the ring of the fastest impact, px. */
const [DOT_PX, RING_PX, LARGEST_RING_PX] = [2.2, 5, 26];
/** Maximum number of contacts in the list. */
const MAX_LISTED = 50;

/** The trajectory of each body. */
export function trails(film: Film, look: string, colour: (name: string) => string): SVGElement[] {
  return Object.keys(film.bodies).map((name) => line(pathUntil(film, name, filmLength(film)), { class: look, stroke: colour(name) }));
}

/** Measured positions. */
export function dots(film: Film, pixel: number): SVGElement[] {
  return Object.values(film.bodies).flatMap((track) => film.t.map((_, k) => s("circle", { class: "dot", cx: track.x[k]!, cy: track.y[k]!, r: DOT_PX * pixel })));
}

/** A ring where each contact begins; with `scaled`, as large as the speed of approach. */
export function contactRings(film: Film, pixel: number, scaled: boolean): { t: number; ring: SVGCircleElement }[] {
  const fastest = Math.max(1e-9, ...film.contacts.map((c) => c.speed));
  return film.contacts.flatMap((contact) => {
    const poses = posesAt(film, contact.t);
    const points = contact.between.map((name) => poses.get(name)).filter((p) => p !== undefined);
    if (!points.length) return [];
    const mean = (v: number[]): number => v.reduce((sum, x) => sum + x, 0) / v.length;
    const radius = scaled ? Math.max(2, (LARGEST_RING_PX * contact.speed) / fastest) : RING_PX;
    const place: Attributes = { cx: mean(points.map((p) => p.x)), cy: mean(points.map((p) => p.y)), r: radius * pixel };
    return [{ t: contact.t, ring: s("circle", { class: "contact", ...place, "vector-effect": "non-scaling-stroke" }) }];
  });
}

/** Children of a list of the first contacts, with its summary. */
export function contactList(contacts: readonly Contact[]): HTMLElement[] {
  const items = contacts.slice(0, MAX_LISTED).map((c) => h("li", {}, `${c.t.toFixed(2)} s: ${c.between.join(" and ")}, ${short(c.speed, "m/s")}`));
  const more = contacts.length > MAX_LISTED ? h("p", { class: "help" }, `The first ${MAX_LISTED} of ${contacts.length}.`) : null;
  const title = contacts.length === 1 ? "1 contact in the simulation" : `${contacts.length} contacts in the simulation`;
  return [h("summary", {}, title), h("ol", {}, ...items), ...(more ? [more] : [])];
}
