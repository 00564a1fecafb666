// Figures of a comparison: share solved over attempts, jump starts, and AUCCESS over attempts learned from.

import type { Schema } from "../../api/client";
import { uniqueId, h, put } from "../../dom";
import { key, curvePlot, type CurveSeries } from "../../parts/curvePlot";
import { meanCurve, difference, learningChains, type Evaluation, type Interval, interval, type Learner, mean } from "./scores";

/** An evaluated policy. */
export interface EvaluatedPolicy {
  id: string;
  look: number;
  /** As in the API: `fixed`, `learned_on`, ... */
  training: string;
  evaluation: Evaluation;
  curve: Interval[];
  auccess: Interval;
  /** Shared by policies that differ only by their seed. */
  schooling: string;
}

/** Kinds of training without real interactions. */
const SIMULATION_TRAININGS = ["fixed", "randomised", "believed"];

export interface Figures {
  element: HTMLElement;
  draw: (policies: readonly EvaluatedPolicy[], chance: Evaluation | undefined, learningJobs: readonly Schema<"JobOut">[], real: boolean) => void;
}

/** The figures, initially empty. */
export function figures(): Figures {
  const success = curvePlot({ about: "Share of tasks solved over attempts", x: "attempts", y: "tasks solved", log: true, steps: true, most: 1 });
  const learning = curvePlot({ about: "AUCCESS over attempts learned from in a world", x: "attempts learned from", y: "AUCCESS", most: 1, marked: true });
  const legend = h("figcaption", { class: "row" });
  const none = h("p", { class: "soft" }, "No evaluations yet: select policies and evaluate them.");
  const one = h("input", { type: "checkbox", id: uniqueId("seeds") });
  const seeds = h("p", { class: "seeds" }, one, h("label", { for: one.id }, "Average policies that differ only by their seed: mean with 95 % interval"));
  const bandsOf = h("p", { class: "soft" });
  const curves = h("figure", { class: "solved" }, legend, success.svg, bandsOf, seeds);
  const starts = h("dl", {});
  const jumped = h("section", { class: "starts", "aria-label": "Jump starts" }, h("h3", {}, "Jump start ", h("span", { class: "soft" }, "AUCCESS before any learning in the real world")), starts);
  const further = h("figure", {}, h("figcaption", {}, "Further training in a world"), learning.svg);
  let redraw = (): void => undefined;
  one.addEventListener("change", () => redraw());
  const draw: Figures["draw"] = (all, chance, learningJobs, real) => {
    redraw = () => draw(all, chance, learningJobs, real);
    const groups = [...new Set(all.map((d) => d.schooling))].map((trainingKey) => all.filter((d) => d.schooling === trainingKey));
    seeds.hidden = groups.length === all.length;
    const together = one.checked && !seeds.hidden;
    const policies = together ? groups.map(meanOverSeeds) : all;
    put(bandsOf, together ? "The area under a curve is its AUCCESS." : "The area under a curve is its AUCCESS. Bands: 95 % intervals (Wilson).");
    [curves.hidden, none.hidden] = [!policies.length, policies.length > 0];
    put(legend, ...policies.map((one) => h("span", { class: "name", "data-curve": one.id }, key(one.look), `${one.id} ${one.auccess.value.toFixed(2)}`)));
    success.draw(policies.map(line), Math.max(2, ...policies.map((one) => one.evaluation.attempts)));
    const jumps = real ? all.filter((one) => SIMULATION_TRAININGS.includes(one.training)) : [];
    jumped.hidden = !jumps.length;
    put(starts, ...jumps.flatMap((one) => jumpStart(one, chance)));
    const series = learningCurves(all, learningJobs);
    further.hidden = !series.length;
    learning.draw(series);
  };
  return { element: h("div", { class: "stack" }, none, curves, jumped, further), draw };
}

/** Averages policies that differ only by their seed. */
function meanOverSeeds(of: EvaluatedPolicy[]): EvaluatedPolicy {
  const [first] = of as [EvaluatedPolicy];
  if (of.length === 1) return first;
  const id = `${first.id} and ${of.length - 1} other ${of.length === 2 ? "seed" : "seeds"}`;
  return { ...first, id, curve: meanCurve(of.map((d) => d.curve)), auccess: mean(of.map((d) => d.auccess.value)) };
}

function line(one: EvaluatedPolicy): CurveSeries {
  const x = one.curve.map((_, i) => i + 1);
  return { name: one.id, look: one.look, x, y: one.curve.map((p) => p.value), low: one.curve.map((p) => p.low), high: one.curve.map((p) => p.high) };
}

/** AUCCESS in the real world before any learning there. */
function jumpStart(one: EvaluatedPolicy, chance: Evaluation | undefined): HTMLElement[] {
  const advantage = chance ? difference(one.evaluation.solvedAt, chance.solvedAt) : null;
  return [
    h("dt", {}, h("span", { class: "name" }, key(one.look), one.id)),
    h("dd", {}, h("strong", {}, one.auccess.value.toFixed(2)), advantage ? ` ${interval(advantage, true)} over random` : ""),
  ];
}

/** Learning curves of policies trained from one another. */
function learningCurves(policies: readonly EvaluatedPolicy[], learningJobs: readonly Schema<"JobOut">[]): CurveSeries[] {
  const steps: Learner[] = learningJobs.flatMap((job) => {
    const result = job.result as { policy: string; from: string; interactions: number } | null | undefined;
    return result ? [{ id: result.policy, from: result.from, attempts: result.interactions }] : [];
  });
  const roots = policies.filter((one) => !steps.some((step) => step.id === one.id)).map((one) => ({ id: one.id, from: null, attempts: 0 }));
  return learningChains([...roots, ...steps]).flatMap((way) => {
    const evaluated = way.flatMap((step) => {
      const one = policies.find((d) => d.id === step.id);
      return one ? [{ ...step, one }] : [];
    });
    const last = evaluated.at(-1)?.one;
    if (!last || !evaluated.some((k) => k.attempts > 0)) return [];
    const of = (pick: (i: Interval) => number): number[] => evaluated.map((k) => pick(k.one.auccess));
    return [{ name: last.id, look: last.look, x: evaluated.map((k) => k.attempts), y: of((i) => i.value), low: of((i) => i.low), high: of((i) => i.high) }];
  });
}
