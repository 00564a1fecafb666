// The displayed part of `iplw.posterior/2` (docs/reference/formats.md), in words.

import { short } from "../../parts/slider";
import { capital, enumeration, percent } from "../analysis/actionText";

export interface PosteriorParameter {
  name: string;
  unit: string;
  setting: string | null;
  mean: number;
  sd: number;
  /** 2.5, 5, 25, 50, 75, 95 and 97.5 %. */
  quantiles: number[];
  /** Width relative to the prior's. */
  left: number;
  identifiable: boolean;
}

export interface Posterior {
  converged: boolean;
  warnings: string[];
  parameters: PosteriorParameter[];
  trials: [number, number];
  noise_m: number;
  seed: number;
  sets: { effects: string[]; weight: number }[];
  columns: Record<string, (number | null)[]>;
}

/** Readable name: "linear drag c". */
export function parameterName({ name, setting }: PosteriorParameter): string {
  return `${name.replaceAll("_", " ").replace(".", " ")}${setting ? ` of ${setting}` : ""}`;
}

/** Which parameters are identified, in a sentence. */
export function headline({ parameters }: Posterior): string {
  const [identified, open] = [true, false].map((identifiable) => parameters.filter((p) => p.identifiable === identifiable).map(parameterName)) as [string[], string[]];
  if (!parameters.length) return "There are no parameters.";
  if (!identified.length) return `The trials do not identify ${enumeration(open)}.`;
  const first = `The trials identify ${enumeration(identified)}`;
  return open.length ? `${first}, but not ${enumeration(open)}.` : `${first}.`;
}

/** Whether the samples can be relied on, in a sentence. */
export function convergenceText({ converged }: Posterior): string {
  return converged
    ? "Independent runs of the sampler agree, so the samples can be used."
    : "Independent runs of the sampler do not agree yet, or are too short: treat the intervals with caution, or run again with more samples.";
}

/** A warning as a sentence. */
export function warningText(warning: string): string {
  const text = capital(warning.replace(/([a-z])_(?=[a-z])/g, "$1 "));
  return /[.!?]$/.test(text) ? text : `${text}.`;
}

/** Whether the model lacks a force that the trials share. */
export function lacksForce({ warnings }: Posterior): boolean {
  return warnings.some((warning) => warning.includes("share a force"));
}

/** A mean with the digits that its standard deviation justifies. */
export function valueText({ mean, sd, unit }: PosteriorParameter): string {
  const decimals = sd > 0 ? Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(sd)))) : 3;
  return `${mean.toFixed(decimals)} ± ${sd.toFixed(decimals)}${unitText(unit)}`;
}

/** The 95 % interval. */
export function intervalText({ quantiles, sd }: PosteriorParameter): string {
  const decimals = sd > 0 ? Math.min(6, Math.max(0, 1 - Math.floor(Math.log10(sd)))) : 3;
  return `${(quantiles[0] ?? 0).toFixed(decimals)} to ${(quantiles.at(-1) ?? 0).toFixed(decimals)}`;
}

/** How much narrower than before the trials. */
export function gainText({ left }: PosteriorParameter): string {
  if (left >= 0.95) return "as wide as the prior";
  if (left > 0.6) return `${percent(1 - left)} narrower than the prior`;
  const factor = 1 / left;
  return factor < 10 ? `${short(factor)} times narrower than the prior` : `${Math.round(factor)} times narrower than the prior`;
}

function unitText(unit: string): string {
  return unit === "1" ? "" : ` ${unit.replace("^2", "²")}`;
}
