// Buttons that share a result: its address, and its report as one file.

import type { Context } from "../view";
import { actionButton } from "./actionButtons";
import { reportHtml } from "./reportView";
import { copyButton, saveFile } from "./saveFile";

/** For the job `id`, whose page is open. */
export function shareButtons(id: string, context: Context): HTMLElement[] {
  const save = actionButton("Report (HTML)", "Save the report (HTML)", "One file that opens without a server", () => {
    reportHtml(id, context.signal)
      .then((html) => saveFile(`${id}-report.html`, "text/html", html))
      .catch(context.fail);
  });
  return [copyButton("Copy the link", () => location.href, context.say, context.fail), save];
}
