// What an estimation found, round by round: a curve with its band for each latent, and the residual.

import { h, put } from "../../dom";
import { type BandPlot, bandPlot, type EstimatePoint, type EstimateSeries } from "../../parts/bandPlot";
import { short } from "../../parts/slider";
import { asked, type Known, known, planned, type Round, type Standing } from "./course";

/** Units of latents; parameters of effects have those of the library. */
const UNITS: Record<string, string> = { density: "kg/m²" };

export interface Findings {
  element: HTMLElement;
  /** Shows a run, and another one over it. */
  show: (one: Standing, other: Standing | null) => void;
}

/** `units` are those of parameters of effects, by `effect.parameter`. */
export function findings(units: ReadonlyMap<string, string>): Findings {
  const tiles = new Map<string, Tile>();
  const grid = h("div", { class: "findings" });
  const residual = bandPlot({ about: "Residual of the best sample by round, m² per trajectory", y: "m² per trajectory", logarithmic: true });
  const last = h("div", { class: "words" });
  const unlike = h("p", { class: "soft", hidden: true }, "The two are of different kinds, which cannot be compared.");
  const none = h("p", { class: "soft" }, "Latents are shown after the first round.");
  const misfit = h("figure", { class: "card finding", hidden: true }, h("figcaption", {}, h("h3", {}, "Residual"), last, unlike), residual.svg);
  put(grid, none, misfit);
  const show = (one: Standing, other: Standing | null): void => {
    const rounds = Math.max(planned(one.job), other ? planned(other.job) : 0);
    const names = [...new Set([one, other].flatMap((s) => (s ? s.rounds.flatMap((r) => r.latents.map((l) => l.name)) : [])))];
    for (const name of names) {
      if (!tiles.has(name)) {
        const made = tile(name, units.get(name) ?? UNITS[name] ?? "");
        tiles.set(name, made);
        misfit.before(made.element);
      }
      tiles.get(name)!.show(one, other, rounds);
    }
    // What only a run had that is no longer compared.
    for (const [name, old] of tiles) if (!names.includes(name)) (old.element.remove(), tiles.delete(name));
    const misfits = runs(one, other, (r) => (typeof r.residual === "number" ? { x: r.number + 1, y: r.residual } : null));
    const fitted = misfits.some((r) => r.points.length > 0);
    [none.hidden, misfit.hidden] = [fitted, !fitted];
    residual.draw(misfits, rounds);
    put(last, ...[one, ...(other ? [other] : [])].flatMap((s, i) => standing(s, misfits.find((r) => r.name === s.job.id)?.points.at(-1)?.y, other ? i : null)));
    unlike.hidden = !other || kind(one) === kind(other);
  };
  return { element: h("section", { class: "stack", "aria-label": "Found so far" }, grid), show };
}

/** A run's last residual. */
function standing(of: Standing, residual: number | undefined, compared: number | null): HTMLElement[] {
  if (residual === undefined) return [];
  return [h("p", {}, key(of, compared), h("strong", {}, `${number(residual)} m²`), h("span", { class: "soft" }, ` ${kind(of)}`))];
}

function kind(of: Standing): string {
  return asked(of.job).residual ?? "trajectory";
}

/** Which run it is, where there are two. */
function key(of: Standing, compared: number | null): HTMLElement | null {
  return compared === null ? null : h("span", { class: `key ${compared ? "second" : "first"}` }, of.job.id);
}

interface Tile {
  element: HTMLElement;
  show: (one: Standing, other: Standing | null, rounds: number) => void;
}

function tile(name: string, unit: string): Tile {
  const picture: BandPlot = bandPlot({ about: `${name} by round, with its 95 % interval`, y: unit || "coefficient" });
  const words = h("div", { class: "words" });
  const element = h("figure", { class: "card finding", "data-latent": name }, h("figcaption", {}, h("h3", {}, name), words), picture.svg);
  const show = (one: Standing, other: Standing | null, rounds: number): void => {
    const reading = (r: Round): EstimatePoint | null => {
      const found = r.latents.find((l) => l.name === name);
      return found ? { x: r.number + 1, y: found.value, low: found.ci95[0] ?? null, high: found.ci95[1] ?? null } : null;
    };
    picture.draw(runs(one, other, reading), rounds);
    const both = [one, ...(other ? [other] : [])];
    put(words, ...both.map((s, i) => sentence(known(s).find((l) => l.name === name), unit, key(s, other ? i : null))));
  };
  return { element, show };
}

function runs(one: Standing, other: Standing | null, reading: (r: Round) => EstimatePoint | null): EstimateSeries[] {
  const run = (s: Standing, look: EstimateSeries["look"]): EstimateSeries => ({ name: s.job.id, look, points: s.rounds.map(reading).filter((p) => p !== null) });
  return [...(other ? [run(other, "second")] : []), run(one, "first")];
}

/** What is known of a latent in words. */
function sentence(found: Known | undefined, unit: string, key: HTMLElement | null): HTMLElement {
  if (!found) return h("p", {}, key, "not estimated");
  const [low, high] = found.ci95;
  const finite = typeof low === "number" && typeof high === "number";
  const digits = finite ? seen(high - low) : null;
  const say = (v: number, of = ""): string => (digits === null ? short(v, of) : `${v.toFixed(digits)}${of ? ` ${of}` : ""}`);
  const interval = finite ? `, 95 %: ${say(low)} to ${say(high)}` : "";
  const tag = h("span", { class: `tag ${found.identifiable ? "good" : "warn"}` }, found.identifiable ? "identifiable" : "not identifiable");
  const title = found.identifiable ? null : "The trials do not tell it: the value is merely where the search stands.";
  return h("p", { title }, key, h("strong", { class: found.identifiable ? "" : "soft" }, say(found.value, unit)), h("span", { class: "soft" }, interval), " ", tag);
}

/** Digits after the point with which the ends of an interval of a width are told apart: two that count, three at least. */
export function seen(width: number): number {
  const needed = width > 0 ? 1 - Math.floor(Math.log10(width)) : 0;
  return Math.min(9, Math.max(3, needed));
}

/** A number of any size in three digits. */
export function number(v: number): string {
  return v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5) ? v.toExponential(1) : String(Number(v.toPrecision(3)));
}
