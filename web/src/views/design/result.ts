// The displayed part of `iplw.design/1` (docs/reference/formats.md), in words.

import { enumeration, percent } from "../analysis/actionText";

export interface ExpectedSd {
  name: string;
  before: number;
  after: number;
}

export interface Experiment {
  task: string;
  action: number[];
  information: number;
  standard_error: number;
  /** Nats beyond the experiments before it. */
  adds: number | null;
  /** Expected probability of the right answer, before and after. */
  right: [number, number] | null;
  expected: ExpectedSd[];
  collisions: number;
  rolling_s: number;
  reason: string;
  cost: number;
}

export interface Design {
  config: { question: string; batch: number; candidates: number; worlds: [number, number]; noise: number; seed: number; shortlist: number };
  together: { information: number; standard_error: number; right: [number, number] | null };
  experiments: Experiment[];
  others: Experiment[];
  candidates: number;
  rollouts: number;
  cost: number;
}

/** Share of a width above which a parameter counts as not narrowed. */
const NARROWED_BELOW = 0.95;

/** Readable name of a parameter: "linear drag c". */
export function parameterName(name: string): string {
  return name.replaceAll("_", " ").replace(".", " ");
}

/** How far an experiment narrows a parameter; `null` if hardly at all. */
export function narrowingText({ name, before, after }: ExpectedSd): string | null {
  const share = after / before;
  if (!(share < NARROWED_BELOW)) return null;
  const parameter = parameterName(name);
  if (share > 0.6) return `reduces the uncertainty of ${parameter} by ${percent(1 - share)}`;
  if (share > 0.4) return `halves the uncertainty of ${parameter}`;
  if (share > 0.28) return `reduces the uncertainty of ${parameter} to a third`;
  return `makes ${parameter} ${times(1 / share)} more precise`;
}

/** Texts of all parameters that are narrowed, the most first. */
export function narrowingTexts(experiment: Experiment): string[] {
  return [...experiment.expected].sort((a, b) => a.after / a.before - b.after / b.before).flatMap((e) => narrowingText(e) ?? []);
}

/** A factor: "8 times", "about 1,000 times". */
function times(factor: number): string {
  if (factor >= 1000) return "more than 1000 times";
  const rounded = factor < 10 ? Number(factor.toPrecision(2)) : Math.round(factor);
  return rounded === 2 ? "twice" : `${rounded} times`;
}

/** The design in a sentence. */
export function headline(design: Design): string {
  const [first] = design.experiments;
  if (!first) return "No experiment can be carried out.";
  const { right } = design.together;
  const count = design.experiments.length;
  const subject = count === 1 ? "The best next experiment" : `The best ${count} experiments together`;
  if (right) return `${subject} ${count === 1 ? "is" : "are"} expected to raise the chance of the right answer from ${percent(right[0])} to ${percent(right[1])}.`;
  const best = enumeration(narrowingTexts(first).slice(0, 2));
  if (best) return count === 1 ? `${subject} ${best}.` : `The first of ${count} experiments ${best}.`;
  return `${subject} ${count === 1 ? "is" : "are"} expected to give ${nats(design.together.information)} of information.`;
}

/** An amount of information. */
export function nats(information: number): string {
  return `${Math.max(0, information).toFixed(1)} nats`;
}

/** How far parameters stay unknown after an experiment, if at all. */
export function unchangedText(experiment: Experiment): string | null {
  const unchanged = experiment.expected.filter((e) => narrowingText(e) === null).map((e) => parameterName(e.name));
  return unchanged.length ? `It does not narrow ${enumeration(unchanged)}.` : null;
}
