// Parameters of a posterior: identified or not, value, interval, and what the trials added to the prior.

import { h } from "../../dom";
import { gainText, intervalText, parameterName, type Posterior, valueText } from "./result";

export function parameterTable(posterior: Posterior): HTMLElement {
  const rows = posterior.parameters.map((p) =>
    h(
      "tr",
      { "data-parameter": p.name },
      h("th", { scope: "row" }, parameterName(p)),
      h("td", { "data-label": "Identified" }, h("span", { class: `mark ${p.identifiable ? "yes" : "no"}` }, p.identifiable ? "identified" : "not identified")),
      h("td", { "data-label": "Mean ± sd" }, valueText(p)),
      h("td", { "data-label": "95 % interval" }, intervalText(p)),
      h("td", { "data-label": "Width" }, gainText(p)),
    ),
  );
  const heads = ["Parameter", "Identified", "Mean ± sd", "95 % interval", "Width"].map((text) => h("th", { scope: "col" }, text));
  const table = h("table", { class: "parameters" }, h("thead", {}, h("tr", {}, ...heads)), h("tbody", {}, ...rows));
  return h("section", { class: "card stack", "aria-label": "Parameters" }, h("h2", {}, "Parameters"), table);
}
