// Sensitivities as bars, the most important latent first.

import { h } from "../../dom";
import { bySensitivity, type Sensitivity } from "./result";

export function sensitivityBars(sensitivities: readonly Sensitivity[]): HTMLElement {
  const sorted = bySensitivity(sensitivities);
  const largest = Math.max(1e-9, ...sorted.map((s) => s.stake));
  const rows = sorted.map((s) => {
    const fill = h("span", { class: "fill" });
    fill.style.width = `${Math.max(0, (100 * s.stake) / largest)}%`;
    return h("li", { "data-factor": s.factor }, h("strong", {}, s.factor), h("span", { class: "bar-track", "aria-hidden": "true" }, fill), h("span", { class: "number" }, s.stake.toFixed(2)));
  });
  const about = h("p", { class: "soft" }, "Change of the score for an error of one prior standard deviation.");
  return h("section", { class: "card stack", "aria-label": "Which latent matters" }, h("h2", {}, "Which latent matters"), about, h("ul", { class: "sensitivities" }, ...rows));
}
