// Buttons that share a job: link, report as one HTML file, result as JSON.

import { api, ok } from "../api/client";
import { describeError } from "../api/problem";
import { h, put } from "../dom";
import { reportHtml } from "./reportView";
import "./share.css";

/** The fields that are needed of a job. */
export interface SharedJob {
  id: string;
  state: string;
}

/** Time for which a button says that it is done, ms. */
const DONE_MS = 2_000;

/** "Copy link" copies the page's address; the downloads are enabled when the job has succeeded. */
export function shareButtons(job: SharedJob, signal: AbortSignal): HTMLElement {
  const message = h("span", { class: "soft", role: "status" });
  const button = (label: string, done: string, work: () => Promise<void>): HTMLButtonElement => {
    const element = h("button", { type: "button" }, label);
    element.addEventListener("click", () => {
      put(message);
      element.disabled = true;
      work()
        .then(() => put(message, done))
        .catch((e: unknown) => signal.aborted || put(message, `Not possible: ${describeError(e).detail}`))
        .finally(() => (element.disabled = false));
      setTimeout(() => message.textContent === done && put(message), DONE_MS);
    });
    return element;
  };
  const copy = button("Copy link", "Link copied.", () => copyText(location.href));
  const report = button("Download report (HTML)", "Report downloaded.", async () => saveFile(`${job.id}.html`, "text/html", await reportHtml(job.id, signal)));
  const result = button("Download result (JSON)", "Result downloaded.", async () => {
    const { result } = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id: job.id } }, signal }));
    saveFile(`${job.id}.json`, "application/json", JSON.stringify(result, null, 2));
  });
  const succeeded = job.state === "succeeded";
  return h("div", { class: "row share", role: "group", "aria-label": `Share ${job.id}` }, copy, succeeded ? report : null, succeeded ? result : null, message);
}

/** Saves a text as a file. */
export function saveFile(name: string, type: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type }));
  h("a", { href: url, download: name }).click();
  URL.revokeObjectURL(url);
}

/** Copies a text; without the clipboard (an address that is neither local nor https) by a selection. */
export async function copyText(text: string): Promise<void> {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  const field = h("textarea", { class: "unseen", value: text, readonly: true, "aria-hidden": "true" });
  document.body.append(field);
  field.select();
  const copied = document.execCommand("copy");
  field.remove();
  if (!copied) throw new Error(`the browser does not allow copying; the text is ${text}`);
}
