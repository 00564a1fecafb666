// Texts of a diagnosis.

import { short } from "../../parts/slider";
import type { Effect, HeldOut, Parameter, Report } from "./report";

/** Readable name of an effect. */
export function title(name: string): string {
  return name.replaceAll("_", " ");
}

/** Name of a set of effects; the empty set is the base model. */
export function effectSetName(names: readonly string[]): string {
  return names.length ? names.map(title).join(" + ") : "none (the base model)";
}

/** One-line verdict. */
export function verdictText(report: Report): string {
  const effects = report.effects.map((e) => e.name);
  switch (report.verdict) {
    case "named":
      return `The simulation lacks ${effectSetName(effects)}`;
    case "ambiguous":
      return `One of ${report.rivals.length} is missing; these trials do not distinguish: ${report.rivals.map(effectSetName).join("; ")}`;
    case "unknown":
      return effects.length ? `Something is missing that no effect of the library explains; partly ${effectSetName(effects)}` : "Something is missing that no effect of the library explains";
    case "none":
      return "Nothing is missing: the simulation explains these trials";
    case "insufficient_data":
      return "Too few trials for a conclusion";
  }
}

/** Short labels of the verdicts. */
export const VERDICT_LABELS: Record<Report["verdict"], string> = {
  named: "named",
  ambiguous: "ambiguous",
  unknown: "unknown",
  none: "nothing missing",
  insufficient_data: "insufficient data",
};

/** The server's text with readable names of effects. */
export function plain(text: string): string {
  return sentence(text.replace(/([a-z])_(?=[a-z])/g, "$1 "));
}

/** A sentence with a capital and a full stop. */
export function sentence(text: string): string {
  const capitalised = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(capitalised) ? capitalised : `${capitalised}.`;
}

/** A number with four significant digits. */
export function digits(v: number | null): string {
  if (v === null || !Number.isFinite(v)) return "-";
  const size = Math.abs(v);
  return size !== 0 && (size < 1e-3 || size >= 1e5) ? v.toExponential(2) : String(Number(v.toPrecision(4)));
}

/** A 95 % interval. */
export function interval([low, high]: readonly [number | null, number | null]): string {
  return low === null || high === null ? "unbounded" : `${digits(low)} to ${digits(high)}`;
}

/** Readable unit; empty for dimensionless numbers. */
export function symbol(unit: string): string {
  return unit === "1" ? "" : unit.replace("^2", "²");
}

/** A probability. */
export function probability(p: number): string {
  if (p === 0) return "< 1e-300";
  return p < 1e-3 ? p.toExponential(0) : p.toFixed(3);
}

/** A length in mm or m. */
export function metres(v: number): string {
  return Math.abs(v) < 0.1 ? short(v * 1e3, "mm") : short(v, "m");
}

/** Effect of the extension on the error. */
export function gainText(g: HeldOut): string {
  const removed = g.excess_removed === null ? "no excess error" : `${(100 * Math.min(1, g.excess_removed)).toFixed(1)} % of the excess removed`;
  return `${metres(g.base_rmse)} before, ${metres(g.extended_rmse)} after; noise ${metres(g.floor_rmse)}: ${removed}`;
}

/** Maximum number of settings with separate estimates; for more the range is given. */
const MAX_SETTINGS_LISTED = 3;

/** Estimates of effects in short. */
export function estimatesText(effects: readonly Effect[]): string {
  const one = (e: Effect, p: Parameter): string => {
    const intervalText = p.ci95[0] !== null && p.ci95[1] !== null ? ` (${interval(p.ci95)})` : "";
    const name = effects.length > 1 ? `${title(e.name)} ${p.name}` : p.name;
    return `${name}${p.setting === null ? "" : ` of ${p.setting}`} = ${digits(p.value)}${intervalText} ${symbol(p.unit)}`.trimEnd();
  };
  const many = (e: Effect, name: string, parameters: Parameter[]): string => {
    const values = parameters.map((p) => p.value);
    return `${effects.length > 1 ? `${title(e.name)} ` : ""}${name} from ${digits(Math.min(...values))} to ${digits(Math.max(...values))} ${symbol(parameters[0]!.unit)}`.trimEnd() + ` in ${parameters.length} settings`;
  };
  const all = effects.flatMap((e) =>
    [...new Set(e.parameters.map((p) => p.name))].flatMap((name) => {
      const parameters = e.parameters.filter((p) => p.name === name);
      return parameters.length > MAX_SETTINGS_LISTED ? [many(e, name, parameters)] : parameters.map((p) => one(e, p));
    }),
  );
  return all.join("; ");
}

/** Text of the predictive check. */
export function predictiveCheckText(report: NonNullable<Report["predictive"]>): string {
  const n = report.launches.length;
  const outside = Math.round(report.outside_share * n);
  const outlierText = report.further_off.length ? `outliers: ${report.further_off.join(", ")}` : "no outliers";
  return `Each trial compared with the prediction from the others: ${outside} of ${n} are outside the 95 % range, ${(0.05 * n).toFixed(1)} are expected; ${outlierText}. The median deviation is ${report.usual_ratio.toFixed(2)} times the predicted one.`;
}
