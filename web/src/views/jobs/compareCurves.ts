// Curves of two jobs over each other: of trainings, evaluations and estimations.

import { effectLibrary, parameterUnits } from "../../api/effects";
import { follow } from "../../api/events";
import { hasEnded } from "../../api/jobState";
import { type Child, h, put } from "../../dom";
import { curvePlot, type CurveSeries } from "../../parts/curvePlot";
import type { Context } from "../../view";
import { type EstimationState, followEstimation } from "../calibrate/estimation";
import { findings } from "../calibrate/findings";
import { auccess, curve, difference, evaluation, interval, movingAverage } from "../train/scores";
import { type Curves, updateCurves } from "../train/trainingProgress";
import { type Job, TRAININGS } from "./job";

/** Part of a comparison that displays curves. */
export interface ComparedCurves {
  element: HTMLElement;
  show: (pair: readonly Job[]) => void;
}

/** The loss is averaged over this fraction of its points. */
const SMOOTHING_PARTS = 15;

/** Curves for two jobs of kinds that have some in common. */
export function comparedCurves(pair: readonly Job[], context: Context): ComparedCurves {
  const kinds = pair.map((job) => job.kind);
  if (kinds.every((kind) => TRAININGS.includes(kind))) return trainings(pair, context);
  if (kinds.every((kind) => kind === "evaluate")) return evaluations();
  if (kinds.every((kind) => kind === "iplw")) return estimations(pair, context);
  const text = kinds[0] === kinds[1] ? "Jobs of this kind have no curves: their reports are on their pages." : "The jobs are of different kinds, so there are no curves to compare.";
  return { element: h("p", { class: "soft" }, text), show: () => undefined };
}

/** A legend: the key and the id of each job. */
function legend(pair: readonly Job[], text: (job: Job, index: number) => Child = () => null): HTMLElement {
  return h("div", { class: "row run-keys" }, ...pair.map((job, i) => h("span", {}, h("span", { class: `run-key ${i ? "second" : "first"}` }), h("strong", {}, job.id), text(job, i))));
}

function trainings(pair: readonly Job[], context: Context): ComparedCurves {
  const loss = curvePlot({ about: "Loss over updates", x: "updates", y: "loss, nats" });
  const checks = curvePlot({ about: "Validation AUCCESS over updates", x: "updates", y: "validation AUCCESS", most: 1, marked: true });
  const none = h("p", { class: "soft" }, "Neither training was validated.");
  const curves: Curves[] = pair.map(() => ({ loss: [], validation: [] }));
  const draw = (): void => {
    const of = (name: keyof Curves): CurveSeries[] => pair.flatMap((job, i) => (curves[i]![name].length ? [{ name: job.id, look: i + 1, x: curves[i]![name].map((p) => p.at), y: curves[i]![name].map((p) => p.value) }] : []));
    loss.draw(of("loss").flatMap((raw) => [{ ...raw, name: `${raw.name}, raw`, faint: true }, smoothed(raw)]));
    checks.draw(of("validation"));
    [none.hidden, (checks.svg as unknown as HTMLElement).style.display] = [of("validation").length > 0, of("validation").length ? "" : "none"];
  };
  // A running training reports its curves in events; a finished one has them in its result.
  pair.forEach((job, i) => {
    const add = (now: Job): void => ((curves[i] = updateCurves(curves[i]!, now)), draw());
    add(job);
    if (!hasEnded(job)) follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => add(JSON.parse(event.data) as Job), context.signal).catch(context.fail);
  });
  const figure = (title: string, ...children: Child[]): HTMLElement => h("figure", {}, h("figcaption", {}, h("h3", {}, title)), ...children);
  const element = section("Training", legend(pair), h("div", { class: "figures" }, figure("Loss", loss.svg, h("p", { class: "soft small" }, "Moving average, with the raw values lightly; 0.69 is chance level.")), figure("Validation AUCCESS, in simulation", none, checks.svg)));
  return { element, show: () => undefined };
}

function smoothed(raw: CurveSeries): CurveSeries {
  return { ...raw, y: movingAverage(raw.y, Math.max(3, Math.round(raw.y.length / SMOOTHING_PARTS))) };
}

function evaluations(): ComparedCurves {
  const plot = curvePlot({ about: "Share of tasks solved over attempts", x: "attempts", y: "tasks solved", log: true, steps: true, most: 1 });
  const [keys, text] = [h("div"), h("p")];
  const element = section("Tasks solved over attempts", keys, plot.svg, text, h("p", { class: "soft small" }, "The area under a curve is its AUCCESS. Bands: 95 % intervals (Wilson)."));
  const show = (pair: readonly Job[]): void => {
    const done = pair.map((job) => evaluation(job));
    put(keys, legend(pair, (_, i) => (done[i] ? ` AUCCESS ${interval(auccess(done[i].solvedAt))}` : " no result yet")));
    const series = done.flatMap((e, i): CurveSeries[] => {
      if (!e) return [];
      const points = curve(e.solvedAt, e.attempts);
      return [{ name: e.job, look: i + 1, x: points.map((_, k) => k + 1), y: points.map((p) => p.value), low: points.map((p) => p.low), high: points.map((p) => p.high) }];
    });
    plot.draw(series, Math.max(2, ...done.map((e) => e?.attempts ?? 2)));
    const [one, other] = done;
    const gap = one && other && one.split === other.split && one.world === other.world ? difference(one.solvedAt, other.solvedAt) : null;
    put(text, gap ? `AUCCESS of ${one!.job} minus ${other!.job}, on the same tasks: ${interval(gap, true)}.` : one && other ? "The evaluations are of different tasks or worlds, so their difference has no paired interval." : null);
  };
  return { element, show };
}

function estimations(pair: readonly Job[], context: Context): ComparedCurves {
  const place = h("div", { class: "calibrate" });
  const element = section("Estimates by round", legend(pair), place);
  const states: (EstimationState | null)[] = [null, null];
  const start = async (): Promise<void> => {
    const view = findings(parameterUnits(await effectLibrary(context.signal)));
    put(place, view.element);
    const onRounds = (i: number) => (now: EstimationState): void => {
      states[i] = now;
      if (states[0]) view.show(states[0], states[1] ?? null);
    };
    await Promise.all(pair.map((job, i) => followEstimation(job.id, () => undefined, onRounds(i), context.signal, context.fail)));
  };
  start().catch(context.fail);
  return { element, show: () => undefined };
}

function section(title: string, ...children: Child[]): HTMLElement {
  return h("section", { class: "card stack curves", "aria-label": title }, h("h2", {}, title), ...children);
}
