// Names and texts of a diagnosis.

import { judgeFit, type FitJudgement } from "../../parts/fitQuality";
import type { Report } from "./report";

/** Readable name of an effect. */
export function title(name: string): string {
  return name.replaceAll("_", " ");
}

/** Name of a set of effects; the empty set is the base model. */
export function effectSetName(names: readonly string[]): string {
  return names.length ? names.map(title).join(" + ") : "none (the base model)";
}

/** How well the base simulation and the extended one fit, on held-out trials if there are any. */
export function fitJudgements(report: Report): FitJudgement[] {
  const { residual, gain, effects } = report;
  if (report.verdict === "insufficient_data" || (!residual && !gain.held_out)) return [{ level: "open", text: "Too few trials to judge the fit" }];
  const fit = gain.held_out;
  const base = fit ? judgeFit("The base simulation", fit.base_rmse, fit.floor_rmse) : judgeFit("The base simulation", residual!.base_rmse, residual!.floor_rmse, report.verdict === "none" || null);
  if (!fit || !effects.length) return [base];
  return [base, judgeFit(`The simulation with ${effectSetName(effects.map((e) => e.name))}`, fit.extended_rmse, fit.floor_rmse)];
}
