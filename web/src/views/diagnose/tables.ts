// Tables of a diagnosis.

import { h } from "../../dom";
import type { HeldOut, Report, Score } from "./report";
import { probability, digits, interval, metres, effectSetName, estimatesText, symbol, title } from "./messages";

/** Sets that are shown at once. */
const MAX_SETS_SHOWN = 8;
/** A column's heading; those of numbers stand to the right. */
type Heading = string | { number: string };

/** A table that scrolls by itself where it is wider than its place. */
export function table(caption: string, headings: readonly Heading[], rows: readonly (readonly string[])[]): HTMLElement {
  const right = headings.map((c) => (typeof c === "string" ? null : "n"));
  const names = headings.map((c) => (typeof c === "string" ? c : c.number));
  const heads = names.map((name, i) => h("th", { scope: "col", class: right[i] }, name));
  const body = rows.map((row) => h("tr", {}, ...row.map((text, i) => (i === 0 ? h("th", { scope: "row" }, text) : h("td", { class: right[i], "data-label": names[i] }, text)))));
  return h(
    "div",
    { class: "scroll", tabindex: 0, role: "region", "aria-label": caption },
    h("table", {}, h("caption", {}, caption), h("thead", {}, h("tr", {}, ...heads)), h("tbody", {}, ...body)),
  );
}

export function effectsTable(report: Report): HTMLElement | null {
  const rows = report.effects.flatMap((e) =>
    e.parameters.map((p) => [title(e.name), p.name, p.setting ?? "all", digits(p.value), symbol(p.unit), interval(p.ci95), p.spread === null ? "shared" : digits(p.spread), probability(e.p_value)]),
  );
  if (!rows.length) return null;
  const headings: Heading[] = ["Effect", "Parameter", "Setting", { number: "Value" }, "Unit", "95 % interval", { number: "Spread by launch" }, { number: "p" }];
  return table("Effects found; p is corrected for the search over the library", headings, rows);
}

export function credibleSetList(report: Report): HTMLElement | null {
  if (report.rivals.length < 2) return null;
  return h("ul", { class: "ties" }, ...report.rivals.map((r) => h("li", {}, effectSetName(r))));
}

/** The best of the sets that were fitted, the others behind a click, and those that could not be. */
export function setsTable(report: Report): HTMLElement | null {
  if (!report.scores.length) return null;
  const headings: Heading[] = ["Set", { number: "Score, nats" }, { number: "Worse, probability" }, "Sizes, where it ties"];
  const row = (s: Score): string[] => [effectSetName(s.effects), s.score.toFixed(1), s.probability_worse.toFixed(3), estimatesText(s.sizes)];
  const rest = report.scores.slice(MAX_SETS_SHOWN).map(row);
  const note = "Sets of effects by log predictive density of launches told from the others, beside the best set's; and the bootstrap's probability that a set predicts worse";
  return h(
    "div",
    { class: "stack" },
    table(note, headings, report.scores.slice(0, MAX_SETS_SHOWN).map(row)),
    rest.length ? h("details", {}, h("summary", {}, `Every other set that was fitted (${rest.length})`), table("The other sets", headings, rest)) : null,
    report.failed.length ? h("p", { class: "soft" }, `Could not be fitted, and have not lost: ${report.failed.map(effectSetName).join("; ")}.`) : null,
  );
}

export function gainsTable(report: Report): HTMLElement | null {
  const all: [string, HeldOut | null | undefined][] = [
    ["held-out trials", report.gain.held_out],
    ["held-out trials, with the law without a name", report.residual_law?.held_out],
    ["a setting never fitted", report.gain.extrapolation],
  ];
  const rows = all.flatMap(([on, g]) =>
    g ? [[on, String(g.trials), metres(g.base_rmse), metres(g.extended_rmse), metres(g.floor_rmse), g.excess_removed === null ? "-" : `${(100 * g.excess_removed).toFixed(1)} %`]] : [],
  );
  if (!rows.length) return null;
  const headings: Heading[] = ["On", { number: "Trials" }, { number: "Error before" }, { number: "Error after" }, { number: "Noise" }, { number: "Excess removed" }];
  return table("Errors on trials that were not fitted; starts are fitted for every trial, everything else comes from other trials", headings, rows);
}

export function latentsTable(report: Report): HTMLElement | null {
  const rows = report.calibrated.map((c) => [title(c.name), digits(c.value), c.identifiable ? interval(c.ci95) : "not told by these trials"]);
  return rows.length ? table("Latents estimated along", ["Latent", { number: "Value" }, "95 % interval"], rows) : null;
}

/** The figures behind the verdict. */
export function factsList(report: Report): HTMLElement {
  const { residual: r, unlike } = report;
  const rows: [string, string][] = [
    ["Error of the base model", metres(r.base_rmse)],
    ["Noise floor", metres(r.floor_rmse)],
    ["p of no misfit", probability(r.lack_of_fit_p)],
    ["p of white residuals", probability(r.whiteness_p)],
    ["Correlation of neighbouring residuals", r.autocorrelation.toFixed(2)],
    ["Correlation of the noise", r.noise_correlation.toFixed(2)],
    ["Unexplained share of the excess", report.unexplained_share === null ? "nothing to explain" : report.unexplained_share.toFixed(3)],
    ...(report.remainder ? [["What is left", report.remainder.text] as [string, string]] : []),
    ...unlike.map((u): [string, string] => [`Launches differ in ${title(u.effect)} ${u.parameter}`, `by ${digits(u.spread)} ${symbol(u.unit)} (standard deviation)`]),
  ];
  return h("dl", { class: "facts figures" }, ...rows.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
}
