// The result of a job: in a phrase, as the server's report, else its scalars.

import { ProblemError } from "../../api/problem";
import { type Child, h, put } from "../../dom";
import { reportView } from "../../parts/reportView";
import { short } from "../../parts/slider";
import type { Context } from "../../view";
import type { Job } from "./job";

/** Maximum number of scalars of a result. */
const MAX_FACTS = 16;
/** Fields of results that repeat the request or the job. */
const REPEATED = ["config", "seed", "version", "strategy", "format"];

/** The section of a succeeded job. */
export function resultSection(job: Job, context: Context): HTMLElement {
  const body = h("div", { class: "result-body" }, h("p", { class: "soft" }, "Loading the report …"));
  const element = h("section", { class: "card stack result", "aria-label": "Result" }, h("h2", {}, "Result"), job.summary ? h("p", { class: "phrase" }, job.summary) : null, body);
  reportView(job.id, context.signal)
    .then((report) => put(body, report))
    .catch((e: unknown) => {
      put(body, scalars(job));
      // Not every kind of job has a report.
      if (!(e instanceof ProblemError && e.problem.status === 404)) context.fail(e);
    });
  return element;
}

/** The scalars of a result as a list. */
function scalars(job: Job): HTMLElement {
  const items = resultScalars(job).slice(0, MAX_FACTS).flatMap(([name, text]): Child[] => [h("dt", {}, name), h("dd", {}, text)]);
  return items.length ? h("dl", { class: "facts" }, ...items) : h("p", { class: "soft" }, "This result has no report: download it as JSON.");
}

/** Names and texts of the scalars of a result; estimates with their interval. */
export function resultScalars(job: Job): [string, string][] {
  return Object.entries((job.result ?? {}) as Record<string, unknown>).flatMap(([name, value]): [string, string][] => {
    // Fields of the request are among the settings.
    if (REPEATED.includes(name) || name in job.config) return [];
    const label = name.replaceAll("_", " ");
    const estimates = Array.isArray(value) ? value.map(estimateText).filter((e) => e !== null) : [];
    if (estimates.length) return estimates;
    const text = scalarText(value);
    return text === null ? [] : [[label, text]];
  });
}

/** Text of a scalar, or of a few named numbers; `null` for other values. */
function scalarText(value: unknown): string | null {
  if (typeof value === "string") return value;
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : short(value);
  if (typeof value !== "object" || value === null || Array.isArray(value)) return null;
  const entries = Object.entries(value);
  const isSmall = entries.length > 0 && entries.length <= 6 && entries.every(([, v]) => typeof v === "number");
  return isSmall ? entries.map(([name, v]) => `${name} ${scalarText(v)}`).join(", ") : null;
}

/** Name and text of an estimate with its interval. */
function estimateText(of: unknown): [string, string] | null {
  const { name, value, ci95 } = (of ?? {}) as { name?: unknown; value?: unknown; ci95?: unknown };
  if (typeof name !== "string" || typeof value !== "number") return null;
  const [low, high] = Array.isArray(ci95) ? (ci95 as unknown[]) : [];
  return [name, typeof low === "number" && typeof high === "number" ? `${short(value)}, 95 %: ${short(low)} to ${short(high)}` : `${short(value)}, not identifiable`];
}
