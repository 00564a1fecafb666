// The sensitivities of a performance surface, in words.

import { short } from "../../parts/slider";
import { capital, enumeration } from "../analysis/actionText";

export interface Sensitivity {
  factor: string;
  /** AUCCESS per unit of the factor. */
  slope: number;
  /** Slope times the prior's standard deviation: AUCCESS. */
  stake: number;
  sd?: number;
}

export interface SurfaceResult {
  surface: string;
  sensitivities: Sensitivity[];
  config: { points: number; actions?: number; route: string; seed: number; axes: { factor: string; low: number; high: number }[] };
}

/** A factor matters if an error of one prior standard deviation changes AUCCESS by this much. */
const RELEVANT_STAKE = 0.02;
/** Ratio of stakes above which one factor clearly matters more. */
const CLEAR_RATIO = 1.5;

/** Sensitivities, the most important first. */
export function bySensitivity(sensitivities: readonly Sensitivity[]): Sensitivity[] {
  return [...sensitivities].sort((a, b) => b.stake - a.stake);
}

/** Which latent matters, in a sentence. */
export function headline(family: string, sensitivities: readonly Sensitivity[]): string {
  const [first, second] = bySensitivity(sensitivities);
  if (!first) return `No latents were varied for ${family}.`;
  if (first.stake < RELEVANT_STAKE) return `None of ${enumeration(sensitivities.map((s) => s.factor))} matters much for ${family}.`;
  if (!second || first.stake >= CLEAR_RATIO * second.stake) return `${capital(first.factor)} matters most for ${family}: measure it first.`;
  return `${capital(first.factor)} and ${second.factor} matter about equally for ${family}.`;
}

/** The effect of an error of a latent on the score. */
export function stakeText({ factor, stake, sd }: Sensitivity): string {
  const size = sd === undefined ? "one prior standard deviation" : `one prior standard deviation (${short(sd)})`;
  if (stake < RELEVANT_STAKE) return `An error of ${size} in ${factor} hardly changes the score.`;
  return `An error of ${size} in ${factor} changes the score by about ${stake.toFixed(2)}.`;
}

/** How certain the sensitivities are with so few points. */
export function pointsText(points: number, factors: number): string {
  const few = points < 10 * factors;
  return `${points} points.${few ? " That is a rough picture: 40 points or more are usual." : ""}`;
}

