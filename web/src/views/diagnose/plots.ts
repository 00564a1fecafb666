// Plots of a diagnosis: parameter estimates, residuals, bounces, predictive check.

import { h, put } from "../../dom";
import { choice } from "../../parts/field";
import { plot, type PlotSeries } from "../../parts/plot";
import { columnOf, type Evidence, type Launch, type Report, type Table } from "./report";
import { symbol, title } from "./messages";

/** 97.5 % quantile of the normal distribution. */
const Z_95 = 1.96;
/** Horizontal offset between the two estimates of a trial. */
const TRIAL_OFFSET = 0.3;
/** Minimum number of observations for each mean of a curve, and maximum number of means. */
const [MIN_OBSERVATIONS_PER_MEAN, MAX_MEANS] = [12, 24];
/** Minimum approach speed of a bounce, as a share of the largest; slower ones are uninformative. */
const MIN_APPROACH_SHARE = 0.05;

/** A plot for each amplitude of the reported model. */
export function parameterPlots(report: Report, signal: AbortSignal): HTMLElement[] {
  const names = report.effects.flatMap((e) => [...new Set(e.parameters.map((p) => p.name))].map((name) => [e, name] as const));
  return names.flatMap(([effect, name]) => {
    const estimates = report.launches.flatMap((l) => l.sizes.filter((s) => s.effect === effect.name && s.parameter === name).map((s) => ({ launch: l, ...s })));
    if (!estimates.length) return [];
    const separate = estimates.filter((s) => s.alone !== null);
    const pooled = (l: Launch) => effect.parameters.find((p) => p.name === name && (p.setting === null || p.setting === l.setting));
    const shared = estimates.map((s) => ({ x: s.launch.trial, p: pooled(s.launch) })).filter((s) => s.p !== undefined);
    const series: PlotSeries[] = [
      {
        name: "all trials, with the sd between trials",
        look: "line",
        colour: "--soft",
        x: shared.map((s) => s.x),
        y: shared.map((s) => s.p!.value),
        low: shared.map((s) => s.p!.value - (s.p!.spread ?? 0)),
        high: shared.map((s) => s.p!.value + (s.p!.spread ?? 0)),
      },
      intervals("trial alone, 95 %", "--simulated", separate.map((s) => [s.launch.trial, s.alone![0], Z_95 * s.alone![1]]), true),
      intervals("given the other trials, 95 %", "--extended", estimates.map((s) => [s.launch.trial + TRIAL_OFFSET, s.value, Z_95 * s.sd]), false),
    ];
    const unit = effect.parameters.find((p) => p.name === name)?.unit;
    const note = "Alone: least squares. Given the other trials: best linear unbiased prediction (BLUP).";
    return [plot({ title: `${title(effect.name)}: ${name}`, x: "trial", y: [name, symbol(unit ?? "")].filter(Boolean).join(", "), note, counts: true }, series, signal)];
  });
}

function intervals(name: string, colour: string, of: readonly (readonly [number, number, number])[], dashed: boolean): PlotSeries {
  return { name, look: "dots", colour, dashed, x: of.map((p) => p[0]), y: of.map((p) => p[1]), low: of.map((p) => p[1] - p[2]), high: of.map((p) => p[1] + p[2]) };
}

/** Abscissae of residual plots with their axis labels. */
const ABSCISSAE: Record<string, [string, (e: Table) => number[]]> = {
  time: ["t, s", (e) => columnOf(e, "t")],
  x: ["x, m", (e) => columnOf(e, "x")],
  y: ["y, m", (e) => columnOf(e, "y")],
  speed: ["speed, m/s", speeds],
  vx: ["vx, m/s", (e) => columnOf(e, "vx")],
  vy: ["vy, m/s", (e) => columnOf(e, "vy")],
};

/** Residuals of both models over a selectable abscissa; their size by setting; accelerations over speed. */
export function residuals(report: Report, signal: AbortSignal): HTMLElement[] {
  const { evidence } = report;
  if (!evidence?.points.rows.length) return [];
  const place = h("div", { class: "pair" });
  const show = (name: string): void => put(place, ...(["x", "y"] as const).map((axis) => residual(evidence.points, name, axis, signal))) && undefined;
  const abscissa = choice("Over", Object.keys(ABSCISSAE).map((name) => [name, name] as const), "time", show);
  show("time");
  return [h("div", { class: "row" }, abscissa.element), place, h("div", { class: "pair" }, bySetting(evidence, signal), accelerations(evidence, signal))];
}

function residual(points: Table, abscissa: string, axis: "x" | "y", signal: AbortSignal): HTMLElement {
  const [label, of] = ABSCISSAE[abscissa]!;
  const [x, before, after] = [of(points), columnOf(points, `before_${axis}`), columnOf(points, `after_${axis}`)];
  const curve = means(x, before.map((v, i) => v - after[i]!));
  const informative = curve.y.some((v) => v !== 0) ? [{ name: "removed by the extension, mean", look: "line" as const, colour: "--ink", ...curve }] : [];
  const series: PlotSeries[] = [
    { name: "before", look: "dots", colour: "--simulated", dashed: true, x, y: before },
    { name: "after", look: "dots", colour: "--extended", x, y: after },
    ...informative,
  ];
  return plot({ title: `Residual in ${axis} over ${abscissa}`, x: label, y: `measured - simulated ${axis}, m` }, series, signal);
}

function bySetting(evidence: Evidence, signal: AbortSignal): HTMLElement {
  const { points, settings } = evidence;
  const [estimates, speed, bx, by] = [columnOf(points, "setting"), speeds(points), columnOf(points, "before_x"), columnOf(points, "before_y")];
  const colours = ["--simulated", "--extended", "--good", "--bad", "--warn", "--soft"];
  const series = settings.slice(0, colours.length).map((name, k): PlotSeries => {
    const rows = estimates.flatMap((v, i) => (v === k ? [i] : []));
    return { name: name || "all trials", look: "dots", colour: colours[k]!, dashed: k % 2 === 1, x: rows.map((i) => speed[i]!), y: rows.map((i) => Math.hypot(bx[i]!, by[i]!)) };
  });
  return plot({ title: "Residual of the base model, by setting", x: "speed, m/s", y: "residual, m" }, series, signal);
}

function accelerations(evidence: Evidence, signal: AbortSignal): HTMLElement | null {
  const { pushes } = evidence;
  if (!pushes.rows.length) return null;
  const speed = columnOf(pushes, "speed");
  const report = (axis: string): PlotSeries[] => {
    const y = columnOf(pushes, `found_${axis}`);
    return y.some((v) => v !== 0) ? [{ name: `${axis} by the extension, mean`, look: "line", colour: axis === "ax" ? "--simulated" : "--extended", ...means(speed, y) }] : [];
  };
  const series: PlotSeries[] = [
    { name: "ax", look: "dots", colour: "--simulated", dashed: true, x: speed, y: columnOf(pushes, "ax") },
    { name: "ay", look: "dots", colour: "--extended", x: speed, y: columnOf(pushes, "ay") },
    ...report("ax"),
    ...report("ay"),
  ];
  return plot({ title: "Acceleration missing in the base model", x: "speed, m/s", y: "acceleration, m/s²", note: "By segments of flight." }, series, signal);
}

/** Impulses and restitution of bounces: observed and by both models. */
export function bounces(report: Report, signal: AbortSignal): HTMLElement[] {
  const all = report.evidence?.bounces;
  if (!all?.rows.length) return [];
  const largest = Math.max(...columnOf(all, "seen_approach").filter(Number.isFinite));
  const approaches = ["seen", "base", "extended"].map((sources) => all.columns.indexOf(`${sources}_approach`));
  const informative: Table = { columns: all.columns, rows: all.rows.filter((row) => approaches.every((i) => (row[i] ?? 0) > MIN_APPROACH_SHARE * largest)) };
  if (!informative.rows.length) return [];
  const who = [["measured", "--ink", false], ["base model", "--simulated", true], ["extended model", "--extended", false]] as const;
  const of = (k: number, name: string): number[] => columnOf(informative, `${["seen", "base", "extended"][k]}_${name}`);
  const bouncePlot = (heading: string, x: string, y: string, at: (k: number) => [number[], number[]]): HTMLElement =>
    plot({ title: heading, x, y }, who.map(([name, colour, dashed], k): PlotSeries => ({ name, look: "dots", colour, dashed, x: at(k)[0], y: at(k)[1] })), signal);
  const [impact, impulse] = ["impact speed, m/s", "impulse over mass, m/s"];
  return [
    h("div", { class: "pair" },
      bouncePlot("Impulse along the normal", impact, impulse, (k) => [of(k, "approach"), of(k, "normal")]),
      bouncePlot("Impulse along the surface", "slip velocity before, m/s", impulse, (k) => [of(k, "slip"), of(k, "along")]),
      bouncePlot("Restitution", impact, "rebound / impact speed", (k) => [of(k, "approach"), of(k, "normal").map((v, i) => v / of(k, "approach")[i]! - 1)])),
  ];
}

/** Sorted p-values of the trials with the expected range. */
export function predictivePlot(report: NonNullable<Report["predictive"]>, signal: AbortSignal): HTMLElement | null {
  const n = report.sorted.length;
  if (n < 2) return null;
  const x = report.sorted.map((_, k) => (k + 1) / (n + 1));
  const series: PlotSeries[] = [
    { name: "expected range, 95 %", look: "line", colour: "--soft", x, y: x, low: report.sorted.map((s) => s[1]), high: report.sorted.map((s) => s[2]) },
    { name: "trials", look: "dots", colour: "--extended", x, y: report.sorted.map((s) => s[0]) },
  ];
  const note = "Points below the band: outliers. A flat curve: predictions too cautious.";
  return plot({ title: "p-values of the trials, sorted", x: "share of trials", y: "p-value", note }, series, signal);
}

/** Autocorrelation of residuals, if available. */
export function correlation(report: Report, signal: AbortSignal): HTMLElement[] {
  const both = report.evidence?.autocorrelation;
  if (!both) return [];
  const x = both[0].map((_, lag) => lag);
  const series: PlotSeries[] = [
    { name: "before", look: "line", colour: "--simulated", dashed: true, x, y: both[0] },
    { name: "after", look: "line", colour: "--extended", x, y: both[1] },
  ];
  return [plot({ title: "Autocorrelation of residuals", x: "lag, observations", y: "correlation", note: "White noise has none beyond lag 0." }, series, signal)];
}

/** Means over bins with about equal counts along x. */
export function means(x: readonly number[], y: readonly number[]): { x: number[]; y: number[] } {
  const points = x.map((v, i) => [v, y[i]!] as const).filter((p) => p.every(Number.isFinite)).sort((a, b) => a[0] - b[0]);
  const count = Math.min(MAX_MEANS, Math.max(1, Math.floor(points.length / MIN_OBSERVATIONS_PER_MEAN)));
  if (!points.length) return { x: [], y: [] };
  const bins = Array.from({ length: count }, (_, k) => points.slice(Math.floor((k * points.length) / count), Math.floor(((k + 1) * points.length) / count)));
  const mean = (bin: typeof points, k: 0 | 1): number => bin.reduce((sum, p) => sum + p[k], 0) / bin.length;
  return { x: bins.map((b) => mean(b, 0)), y: bins.map((b) => mean(b, 1)) };
}

function speeds(points: Table): number[] {
  const [vx, vy] = [columnOf(points, "vx"), columnOf(points, "vy")];
  return vx.map((v, i) => Math.hypot(v, vy[i]!));
}
