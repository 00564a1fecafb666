// Tables of a diagnosis.

import { h } from "../../dom";
import type { HeldOut, Report, Score } from "./report";
import { probability, digits, interval, metres, effectSetName, estimatesText, symbol, title } from "./messages";

/** Sets displayed at first. */
const MAX_SETS_SHOWN = 8;
/** A column heading; columns of numbers are right-aligned. */
type Heading = string | { number: string };

/** A table that scrolls horizontally if necessary. */
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
    e.parameters.map((p) => [title(e.name), p.name, p.setting ?? "all", digits(p.value), symbol(p.unit), interval(p.ci95), p.spread === null ? "shared" : digits(p.spread), e.probability.toFixed(2)]),
  );
  if (!rows.length) return null;
  const headings: Heading[] = ["Effect", "Parameter", "Setting", { number: "Value" }, "Unit", "95 % interval", { number: "Sd between trials" }, { number: "Probability" }];
  return table("Effects with the posterior probability that they act", headings, rows);
}

export function credibleSetList(report: Report): HTMLElement | null {
  if (report.rivals.length < 2) return null;
  return h("ul", { class: "ties" }, ...report.rivals.map((r) => h("li", {}, effectSetName(r))));
}

/** The best fitted sets, the others in a collapsed table, and those that failed. */
export function setsTable(report: Report): HTMLElement | null {
  if (!report.scores.length) return null;
  const headings: Heading[] = ["Set", { number: "Score, nats" }, { number: "Probability" }, "Estimates, if in the credible set"];
  const row = (s: Score): string[] => [effectSetName(s.effects), s.score.toFixed(1), s.probability.toFixed(3), estimatesText(s.sizes)];
  const rest = report.scores.slice(MAX_SETS_SHOWN).map(row);
  const note = "Sets of effects by log posterior probability relative to the best set, and their posterior probability";
  return h(
    "div",
    { class: "stack" },
    table(note, headings, report.scores.slice(0, MAX_SETS_SHOWN).map(row)),
    rest.length ? h("details", {}, h("summary", {}, `Other fitted sets (${rest.length})`), table("Other sets", headings, rest)) : null,
    report.failed.length ? h("p", { class: "soft" }, `Could not be fitted: ${report.failed.map(effectSetName).join("; ")}.`) : null,
  );
}

export function gainsTable(report: Report): HTMLElement | null {
  const all: [string, HeldOut | null | undefined][] = [
    ["held-out trials", report.gain.held_out],
    ["held-out trials, with the empirical formula", report.residual_law?.held_out],
    ["a setting not used for fitting", report.gain.extrapolation],
  ];
  const rows = all.flatMap(([on, g]) =>
    g ? [[on, String(g.trials), metres(g.base_rmse), metres(g.extended_rmse), metres(g.floor_rmse), g.excess_removed === null ? "-" : `${(100 * g.excess_removed).toFixed(1)} %`]] : [],
  );
  if (!rows.length) return null;
  const headings: Heading[] = ["On", { number: "Trials" }, { number: "Error before" }, { number: "Error after" }, { number: "Noise" }, { number: "Excess removed" }];
  return table("Errors on held-out trials; only the initial state is fitted to each trial", headings, rows);
}

export function latentsTable(report: Report): HTMLElement | null {
  const rows = report.calibrated.map((c) => [title(c.name), digits(c.value), c.identifiable ? interval(c.ci95) : "not identifiable"]);
  return rows.length ? table("Estimated latents", ["Latent", { number: "Value" }, "95 % interval"], rows) : null;
}

/** Statistics behind the verdict. */
export function factsList(report: Report): HTMLElement {
  const { residual: r, unlike, odd_trials: odd, surface_offsets: offsets } = report;
  const misfit: [string, string][] = r
    ? [
        ["Error of the base model", metres(r.base_rmse)],
        ["Noise floor", metres(r.floor_rmse)],
        ["p-value, no misfit", probability(r.lack_of_fit_p)],
        ["p-value, white residuals", probability(r.whiteness_p)],
        ["Correlation of neighbouring residuals", r.autocorrelation.toFixed(2)],
        ["Correlation of the noise", r.noise_correlation.toFixed(2)],
      ]
    : [];
  const rows: [string, string][] = [
    ...misfit,
    ["Unexplained share of the excess error", report.unexplained_share === null ? "nothing to explain" : report.unexplained_share.toFixed(3)],
    ...(report.remainder ? [["Residual summary", report.remainder.text] as [string, string]] : []),
    ...(odd ?? []).map((o): [string, string] => [`Trial ${o.name} left out as unlike the others`, `p = ${probability(o.p)}`]),
    ...(offsets ?? []).map((o): [string, string] => [`Offset of ${o.name} from the scene, along its normal`, `${metres(o.offset)} (sd ${metres(o.sd)})`]),
    ...unlike.map((u): [string, string] => [`Between-trial variation of ${title(u.effect)} ${u.parameter}`, `${digits(u.spread)} ${symbol(u.unit)} (sd)`]),
  ];
  return h("dl", { class: "facts figures" }, ...rows.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
}
