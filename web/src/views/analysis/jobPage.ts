// The page of a job: its progress, then its result: a sentence, next steps, interactive parts, and the report.

import { ProblemError } from "../../api/problem";
import { type Child, h, put } from "../../dom";
import { followJob } from "../../parts/jobProgress";
import { reportView } from "../../parts/reportView";
import { shareButtons } from "../../parts/share";
import { type Context, link } from "../../view";
import { type AnalysisKind, type Job, jobById, jobTitle } from "./kind";

/** The native part of a result; pictures and tables are in the report. */
export interface ResultPage {
  /** The result in a sentence. */
  headline: string;
  /** Further sentences. */
  notes: Child[];
  /** Links and buttons for what to do with it. */
  steps: Child[];
  /** Interactive parts. */
  parts: HTMLElement[];
  /** In place of the report, from a server that has none. */
  substitutes: HTMLElement[];
  /** Fields of the form for another run. */
  request: Record<string, string>;
}

/** Follows a job and displays its result. */
export async function jobPage(place: HTMLElement, kind: AnalysisKind, id: string, show: (job: Job) => Promise<ResultPage>, context: Context): Promise<void> {
  const job = await jobById(id, context.signal);
  if (job.kind !== kind.kind) throw new Error(`${id} is not a ${kind.title.toLowerCase()}; see it under Jobs.`);
  const container = h("div", { class: "analysis stack" });
  put(place, container);
  const links = [h("a", { href: link(kind.view) }, "Start another"), h("a", { href: link("jobs", [id]) }, "Details of the job")];
  const onSuccess = (now: Job): void => {
    show(now)
      .then((page) => put(container, head(kind, now, page, context), ...page.parts, report(now, page, context)))
      .catch(context.fail);
  };
  await followJob(container, job, { subject: kind.subject, links }, onSuccess, context);
}

function head(kind: AnalysisKind, job: Job, page: ResultPage, context: Context): HTMLElement {
  const links = [h("a", { href: link(kind.view, [], page.request) }, "Change and run again"), h("a", { href: link("jobs", [job.id]) }, "Details of the job")];
  return h(
    "section",
    { class: "card stack result-head", "aria-label": "Result" },
    h("p", { class: "soft" }, `${jobTitle(job, kind)} · ${job.id}`),
    h("h2", {}, page.headline),
    ...page.notes,
    page.steps.length ? h("div", { class: "row steps" }, ...page.steps) : null,
    h("div", { class: "row minor" }, ...links, shareButtons(job, context.signal)),
  );
}

/** The server's report, without its heading, because the page has one; empty until it is loaded. */
function report(job: Job, { substitutes }: ResultPage, context: Context): HTMLElement {
  const place = h("div", { class: "stack" });
  reportView(job.id, context.signal)
    .then((view) => {
      fitIntoCard(view);
      put(place, h("section", { class: "card", "aria-label": "Report" }, view));
    })
    .catch((e: unknown) => {
      if (context.signal.aborted) return;
      put(place, ...substitutes);
      if (!(e instanceof ProblemError && e.problem.status === 404)) context.fail(e);
    });
  return place;
}

/** Removes the heading of a report and the margins of its page. */
function fitIntoCard({ shadowRoot }: HTMLElement): void {
  shadowRoot?.querySelector("main > header")?.remove();
  const sheet = new CSSStyleSheet();
  sheet.replaceSync("main.report { max-width: none; padding: 0; }");
  shadowRoot?.adoptedStyleSheets.push(sheet);
}
