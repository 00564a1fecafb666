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
  const page = new DOMParser().parseFromString(await reportHtml(id, signal), "text/html");
  const host = h("div", { class: "report", "data-report": id });
  const root = host.attachShadow({ mode: "open" });
  // Style elements are forbidden by the page's policy; constructed sheets are not.
  const sheet = new CSSStyleSheet();
  sheet.replaceSync([...page.querySelectorAll("style")].map((style) => style.textContent ?? "").join("\n"));
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
