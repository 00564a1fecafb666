// The quality of an estimation's fit in words.

import { type FitJudgement, judgeFit } from "../../parts/fitQuality";
import { type EstimationState, fitQuality } from "./estimation";

/** How well the estimation's simulation fits, in words. */
export function judgement(now: EstimationState): FitJudgement {
  const fit = fitQuality(now);
  if (!fit || fit.adequate === null) return { level: "open", text: fit ? `${fit.text.charAt(0).toUpperCase()}${fit.text.slice(1)}` : "The fit was not checked" };
  const { level, text } = judgeFit(fit.adequate ? "The fit" : "The model", fit.error_m ?? NaN, fit.noise_m ?? NaN, fit.adequate);
  return { level, text: fit.adequate ? `${text}.` : `${text}. An effect is missing, and the estimates ignore it: diagnose these trials.` };
}
