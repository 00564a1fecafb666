// The displayed part of `iplw.plan/1` (docs/reference/formats.md), in words.

import { percent } from "../analysis/actionText";

export interface RankedAction {
  action: number[];
  successes: number;
  draws: number;
  share: number;
  probability: number | null;
  standard_error: number | null;
}

export interface Plan {
  task: string;
  config: { actions: number; draws: number; seed: number; exact: number; perturb: number };
  posterior: { source: string; draws: number };
  candidates: number;
  invalid: number;
  rollouts: number;
  complete: boolean;
  actions: RankedAction[];
}

/** Probability of success: of fresh rollouts, or of those it was ranked by. */
export function successProbability(action: RankedAction): number {
  return action.probability ?? action.share;
}

/** "94 ± 6 %", with the standard error. */
export function probabilityText(action: RankedAction): string {
  if (action.standard_error === null) return percent(successProbability(action));
  return `${Math.round(100 * successProbability(action))} ± ${percent(action.standard_error)}`;
}

const SOURCES: Record<string, string> = { prior: "the prior", posterior: "the posterior", point: "the chosen world" };

/** The plan in a sentence; `withEffects`: whether the effects of a scene were added to the prior. */
export function headline(plan: Plan, withEffects: boolean): string {
  const [first] = plan.actions;
  if (!first) return `No action can be placed in ${plan.task}.`;
  const source = SOURCES[plan.posterior.source] ?? plan.posterior.source;
  return `The action ranked first solves ${plan.task} with a probability of ${percent(successProbability(first))} under ${source}${withEffects ? " with the scene's effects" : ""}.`;
}

/** Probability below which more knowledge is worth more than an attempt. */
const SAFE_PROBABILITY = 0.9;

/** Whether the success of the best action is uncertain. */
export function isUncertain(plan: Plan): boolean {
  return plan.actions.slice(0, plan.config.exact).every((action) => successProbability(action) < SAFE_PROBABILITY);
}

/** How the plan was computed. */
export function methodText(plan: Plan): string {
  const ranking = plan.complete ? "" : " The time or rollout limit ended the search: other actions may be better.";
  return `${plan.candidates} candidate actions, ${plan.invalid} of which cannot be placed; ${plan.rollouts} rollouts. The probabilities are from new rollouts, after the ranking.${ranking}`;
}
