// The result of a diagnosis: what to do next, the server's report, and a viewer of single trials.

import type { Schema } from "../../api/client";
import { h, put } from "../../dom";
import { reportView } from "../../parts/reportView";
import type { Context } from "../../view";
import { actions } from "./actions";
import type { Report } from "./report";
import { trialViewer } from "./trialViewer";

/** Displays a result in the container. */
export async function showResult(place: HTMLElement, report: Report, job: Schema<"JobOut">, context: Context): Promise<void> {
  const reportPlace = h("section", { class: "card", "aria-label": "Report", "aria-busy": "true" }, h("p", { class: "soft" }, "Loading the report…"));
  const body = h("div", { class: "stack", "data-verdict": report.verdict }, actions(report, job, context), reportPlace, trialViewer(report, context));
  put(place, body);
  try {
    put(reportPlace, await reportView(job.id, context.signal));
  } catch (e) {
    put(reportPlace, h("p", { class: "soft" }, "The report could not be loaded. Its data can be saved above."));
    context.fail(e);
  }
  reportPlace.removeAttribute("aria-busy");
  body.dataset.whole = "true";
}
