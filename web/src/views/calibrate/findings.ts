// Results of an estimation by round: a curve with interval for each latent, and the residual.

import { h, put } from "../../dom";
import { type BandPlot, bandPlot, type EstimatePoint, type EstimateSeries } from "../../parts/bandPlot";
import { fitLine } from "../../parts/fitQuality";
import { short } from "../../parts/slider";
import { requestOf, type LatentEstimate, currentEstimates, fitQuality, maxRounds, type Round, type EstimationState } from "./estimation";
import { judgement } from "./judgement";

/** Units of latents; effect parameters have the units of the library. */
const UNITS: Record<string, string> = { density: "kg/m²" };

export interface Findings {
  element: HTMLElement;
  /** Displays an estimation, optionally with another one for comparison. */
  show: (one: EstimationState, other: EstimationState | null) => void;
}

/** `units`: of effect parameters, by `effect.parameter`. */
export function findings(units: ReadonlyMap<string, string>): Findings {
  const plots = new Map<string, LatentPlot>();
  const grid = h("div", { class: "findings" });
  const residual = bandPlot({ about: "Residual of the best sample by round, m² per trajectory", y: "m² per trajectory", logarithmic: true });
  const last = h("div", { class: "words" });
  const incomparable = h("p", { class: "soft", hidden: true }, "The residuals are of different kinds and cannot be compared.");
  const fit = h("div", { class: "words" });
  const none = h("p", { class: "soft" }, "Latents are displayed after the first round.");
  const misfit = h("figure", { class: "card finding", hidden: true }, h("figcaption", {}, h("h3", {}, "Residual"), last, incomparable), residual.svg);
  put(grid, none, misfit);
  const show = (one: EstimationState, other: EstimationState | null): void => {
    const rounds = Math.max(maxRounds(one.job), other ? maxRounds(other.job) : 0);
    const names = [...new Set([one, other].flatMap((s) => (s ? s.rounds.flatMap((r) => r.latents.map((l) => l.name)) : [])))];
    for (const name of names) {
      if (!plots.has(name)) {
        const plot = latentPlot(name, units.get(name) ?? UNITS[name] ?? "");
        plots.set(name, plot);
        misfit.before(plot.element);
      }
      plots.get(name)!.show(one, other, rounds);
    }
    // Remove plots of latents that are no longer compared.
    for (const [name, old] of plots) if (!names.includes(name)) (old.element.remove(), plots.delete(name));
    const misfits = seriesOf(one, other, (r) => (typeof r.residual === "number" ? { x: r.number + 1, y: r.residual } : null));
    const fitted = misfits.some((r) => r.points.length > 0);
    [none.hidden, misfit.hidden] = [fitted, !fitted];
    residual.draw(misfits, rounds);
    put(last, ...[one, ...(other ? [other] : [])].flatMap((s, i) => residualText(s, misfits.find((r) => r.name === s.job.id)?.points.at(-1)?.y, other ? i : null)));
    put(fit, ...[one, ...(other ? [other] : [])].flatMap((s, i) => fitText(s, other ? i : null)));
    incomparable.hidden = !other || residualKind(one) === residualKind(other);
  };
  return { element: h("section", { class: "stack", "aria-label": "Results so far" }, fit, grid), show };
}

/** The last residual of an estimation. */
function residualText(of: EstimationState, residual: number | undefined, compared: number | null): HTMLElement[] {
  if (residual === undefined) return [];
  return [h("p", {}, runKey(of, compared), h("strong", {}, `${formatNumber(residual)} m²`), h("span", { class: "soft" }, ` ${residualKind(of)}`))];
}

/** How well the simulation reproduces the trials, of each of two that are compared. */
function fitText(of: EstimationState, compared: number | null): HTMLElement[] {
  return fitQuality(of) && compared !== null ? [h("div", { class: "row compared-fit" }, runKey(of, compared), fitLine(judgement(of)))] : [];
}

function residualKind(of: EstimationState): string {
  return requestOf(of.job).residual ?? "trajectory";
}

/** Label of an estimation, if two are compared. */
function runKey(of: EstimationState, compared: number | null): HTMLElement | null {
  return compared === null ? null : h("span", { class: `key ${compared ? "second" : "first"}` }, of.job.id);
}

interface LatentPlot {
  element: HTMLElement;
  show: (one: EstimationState, other: EstimationState | null, rounds: number) => void;
}

function latentPlot(name: string, unit: string): LatentPlot {
  const picture: BandPlot = bandPlot({ about: `${name} by round, with its 95 % interval`, y: unit || "coefficient" });
  const words = h("div", { class: "words" });
  const element = h("figure", { class: "card finding", "data-latent": name }, h("figcaption", {}, h("h3", {}, name), words), picture.svg);
  const show = (one: EstimationState, other: EstimationState | null, rounds: number): void => {
    const pointOf = (r: Round): EstimatePoint | null => {
      const estimate = r.latents.find((l) => l.name === name);
      return estimate ? { x: r.number + 1, y: estimate.value, low: estimate.ci95[0] ?? null, high: estimate.ci95[1] ?? null } : null;
    };
    picture.draw(seriesOf(one, other, pointOf), rounds);
    const both = [one, ...(other ? [other] : [])];
    put(words, ...both.map((s, i) => estimateText(currentEstimates(s).find((l) => l.name === name), unit, runKey(s, other ? i : null), fitQuality(s)?.adequate === false)));
  };
  return { element, show };
}

function seriesOf(one: EstimationState, other: EstimationState | null, pointOf: (r: Round) => EstimatePoint | null): EstimateSeries[] {
  const run = (s: EstimationState, look: EstimateSeries["look"]): EstimateSeries => ({ name: s.job.id, look, points: s.rounds.map(pointOf).filter((p) => p !== null) });
  return [...(other ? [run(other, "second")] : []), run(one, "first")];
}

/** Text of an estimate. */
function estimateText(estimate: LatentEstimate | undefined, unit: string, key: HTMLElement | null, badFit: boolean): HTMLElement {
  if (!estimate) return h("p", {}, key, "not estimated");
  const [low, high] = estimate.ci95;
  const finite = typeof low === "number" && typeof high === "number";
  const digits = finite ? significantDigits(high - low) : null;
  const format = (v: number, of = ""): string => (digits === null ? short(v, of) : `${v.toFixed(digits)}${of ? ` ${of}` : ""}`);
  const interval = finite ? `, 95 %: ${format(low)} to ${format(high)}${badFit ? " (ignores the misfit)" : ""}` : "";
  const tag = h("span", { class: `tag ${estimate.identifiable ? "good" : "warn"}` }, estimate.identifiable ? "identifiable" : "not identifiable");
  const title = estimate.identifiable ? null : "The trials do not determine it: the value is the current point of the search.";
  return h("p", { title }, key, h("strong", { class: estimate.identifiable ? "" : "soft" }, format(estimate.value, unit)), h("span", { class: "soft" }, interval), " ", tag);
}

/** Decimals that resolve an interval of this width: two significant digits, at least three decimals. */
export function significantDigits(width: number): number {
  const needed = width > 0 ? 1 - Math.floor(Math.log10(width)) : 0;
  return Math.min(9, Math.max(3, needed));
}

/** A number with three significant digits. */
export function formatNumber(v: number): string {
  return v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5) ? v.toExponential(1) : String(Number(v.toPrecision(3)));
}
