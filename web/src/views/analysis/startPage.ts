// The start of an analysis: what it is for, an example, a short form, and the analyses so far.

import { h, put } from "../../dom";
import { showFieldError, showInvalidNumber, type RequestField } from "../../parts/requestField";
import { type Context, link } from "../../view";
import { type AnalysisKind, jobTitle, newestJobs } from "./kind";

/** A job that was started. */
export interface StartedJob {
  id: string;
}

export interface Example {
  /** "Try with bowling:003". */
  label: string;
  about: string;
  /** Starts its job. `say` displays the progress of steps before it. */
  start: (say: (text: string) => void) => Promise<StartedJob>;
}

export interface StartPage {
  kind: AnalysisKind;
  /** Two sentences for somebody who has never heard of it. */
  purpose: string;
  example: Example;
  /** Above the form. */
  notice?: HTMLElement | null;
  main: HTMLElement[];
  more: HTMLElement[];
  fields: readonly RequestField[];
  submit: string;
  /** Starts the job of the form. */
  start: () => Promise<StartedJob>;
  /** Query of the address of this job. */
  query?: () => Record<string, string>;
}

/** Fills a container with the start of an analysis. */
export async function startPage(place: HTMLElement, page: StartPage, context: Context): Promise<void> {
  const list = h("div");
  const form = startForm(page, context);
  const recent = h("section", { class: "card stack", "aria-label": "Recent" }, h("h2", {}, "Recent"), list);
  const aside = h("div", { class: "stack aside" }, introduction(page, context), recent);
  put(place, h("div", { class: "analysis start" }, h("div", { class: "stack" }, page.notice, form), aside));
  await showRecent(list, page.kind, context.signal);
}

function startForm(page: StartPage, context: Context): HTMLElement {
  const button = h("button", { type: "submit", class: "main" }, page.submit);
  const more = h("details", { class: "more" }, h("summary", {}, "More"), h("div", { class: "request-fields" }, ...page.more));
  const form = h("form", { class: "card stack", novalidate: true, "aria-label": page.submit }, h("h2", {}, `New ${page.kind.title.toLowerCase()}`), h("div", { class: "request-fields" }, ...page.main), more, h("div", { class: "row" }, button));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    context.fail(null);
    for (const field of page.fields) field.showError(null);
    if (showInvalidNumber(page.fields)) return;
    button.disabled = true;
    page
      .start()
      .then((job) => (location.hash = link(page.kind.view, [job.id], page.query?.())))
      .catch((e: unknown) => showFieldError(page.fields, e) || context.fail(e))
      .finally(() => (button.disabled = false));
  });
  return form;
}

/** The purpose, with an example. */
function introduction({ kind, purpose, example }: StartPage, context: Context): HTMLElement {
  const button = h("button", { type: "button" }, example.label);
  const progress = h("p", { class: "soft", role: "status" }, example.about);
  button.addEventListener("click", () => {
    context.fail(null);
    button.disabled = true;
    example
      .start((text) => put(progress, text))
      .then((job) => context.signal.aborted || (location.hash = link(kind.view, [job.id])))
      .catch((e: unknown) => (put(progress, example.about), context.fail(e)))
      .finally(() => (button.disabled = false));
  });
  return h("section", { class: "card stack purpose", "aria-label": "Purpose" }, h("h2", {}, `${kind.title}: what for?`), h("p", {}, purpose), h("div", { class: "row" }, button), progress);
}

/** Maximum number of jobs in the list. */
const MAX_ROWS = 8;

async function showRecent(place: HTMLElement, kind: AnalysisKind, signal: AbortSignal): Promise<void> {
  const jobs = await newestJobs(kind.kind, signal);
  if (!jobs.length) return void put(place, h("p", { class: "soft" }, "None yet. Results are kept here, also when you leave the page."));
  const rows = jobs.slice(0, MAX_ROWS).map((job) =>
    h(
      "li",
      {},
      h("a", { href: link(kind.view, [job.id]) }, job.id),
      h("span", {}, jobTitle(job, kind), job.summary ? h("span", { class: "soft" }, ` ${job.summary}`) : null),
      h("span", { class: `state ${job.state}` }, job.state),
    ),
  );
  put(place, h("ul", { class: "recent" }, ...rows), jobs.length > MAX_ROWS ? h("p", { class: "soft" }, h("a", { href: link("jobs") }, "All jobs")) : null);
}
