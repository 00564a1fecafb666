// The report of a job as the server renders it, in the page's theme. The same HTML as `GET /v1/jobs/{id}/report`.

import { problem, send } from "../api/client";
import { ProblemError } from "../api/problem";
import { h } from "../dom";

/** Address of a job's report. */
export function reportAddress(id: string): string {
  return `/v1/jobs/${encodeURIComponent(id)}/report`;
}

/** The HTML of a job's report, for a file. */
export async function reportHtml(id: string, signal: AbortSignal): Promise<string> {
  const response = await send(new Request(reportAddress(id), { signal }));
  if (!response.ok) throw new ProblemError(problem(await response.json().catch(() => null), response), null);
  return response.text();
}

/** The report as an element. Its styles apply inside it only; links within it scroll and unfold. */
export async function reportView(id: string, signal: AbortSignal): Promise<HTMLElement> {
  const page = new DOMParser().parseFromString(trusted(withStylesAsData(await reportHtml(id, signal))), "text/html");
  const host = h("div", { class: "report", "data-report": id });
  const root = host.attachShadow({ mode: "open" });
  // Style elements are forbidden by the page's policy; constructed sheets are not.
  const sheet = new CSSStyleSheet();
  sheet.replaceSync([...page.querySelectorAll(STYLES)].map((style) => style.textContent ?? "").join("\n"));
  root.adoptedStyleSheets = [sheet];
  const main = page.querySelector("main");
  if (main) root.append(document.importNode(main, true));
  root.addEventListener("click", (event) => {
    const anchor = (event.target as Element).closest('a[href^="#"]');
    if (!anchor) return;
    event.preventDefault();
    const target = root.getElementById(anchor.getAttribute("href")!.slice(1));
    if (target instanceof HTMLDetailsElement) target.open = true;
    target?.scrollIntoView({ block: "start" });
    target?.querySelector("summary")?.focus({ preventScroll: true });
  });
  return host;
}

/** Selector of styles as data. */
const STYLES = 'script[type="text/css"]';

/** Style elements as blocks of data: the browser would refuse and log each, even in a document that is not displayed. */
function withStylesAsData(html: string): string {
  return html.replaceAll(/<style\b[^>]*>/gi, '<script type="text/css">').replaceAll(/<\/style>/gi, "</script>");
}

/** The page's policy requires trusted HTML even for a document that runs no scripts, as this one; scripts and inline handlers of
 * what is imported from it are forbidden by the same policy. */
function trusted(html: string): string {
  const types = (window as { trustedTypes?: { createPolicy: (name: string, rules: { createHTML: (text: string) => string }) => { createHTML: (text: string) => string } } }).trustedTypes;
  policy ??= types?.createPolicy("report", { createHTML: (text) => text }) ?? null;
  return policy ? policy.createHTML(html) : html;
}

let policy: { createHTML: (text: string) => string } | null = null;
