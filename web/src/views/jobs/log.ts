// The log of a job, line by line, optionally following its end.

import { all, api, ok, type Schema } from "../../api/client";
import { uniqueId, h } from "../../dom";
import { latest } from "../../parts/latest";
import { clock, day } from "../../parts/time";
import type { Context } from "../../view";

type Line = Schema<"LogLineOut">;

/** Displayed lines; the server keeps as many. */
const MAX_LINES = 1_000;

export interface JobLog {
  element: HTMLElement;
  /** Fetches new lines. */
  update: () => void;
}

export function jobLog(id: string, context: Context): JobLog {
  const box = uniqueId("tail");
  const tail = h("input", { id: box, type: "checkbox", checked: true });
  const lines = h("div", { class: "log", role: "log", tabindex: 0, "aria-label": `Log of ${id}` });
  const none = h("p", { class: "soft" }, "No lines yet.");
  const element = h("section", { class: "card stack", "aria-label": "Log" }, h("div", { class: "row" }, h("h2", {}, "Log"), tail, h("label", { for: box }, "Follow the end")), none, lines);
  let last: Line | null = null;
  const end = (): void => void (tail.checked && (lines.scrollTop = lines.scrollHeight));
  tail.addEventListener("change", end);
  // Scrolling up stops following the end; scrolling to the end resumes it.
  lines.addEventListener("scroll", () => (tail.checked = lines.scrollTop + lines.clientHeight >= lines.scrollHeight - 4));
  const update = latest<null>(async () => {
    const after = last?.number ?? 0;
    try {
      const newLines = await all(
        (cursor) => ok(api.GET("/v1/jobs/{id}/log", { params: { path: { id }, query: { after, limit: MAX_LINES, ...(cursor ? { cursor } : {}) } }, signal: context.signal })),
        (page) => page.lines,
      );
      // Read before appending lines, because that fires a scroll event.
      const wasFollowing = tail.checked;
      for (const line of newLines) {
        lines.append(...rows(line, last));
        last = line;
      }
      while (lines.childElementCount > MAX_LINES) lines.firstElementChild!.remove();
      none.hidden = lines.childElementCount > 0;
      tail.checked = wasFollowing;
      end();
    } catch (e) {
      context.fail(e);
    }
  });
  return { element, update: () => update(null) };
}

/** A line, preceded by its date if that differs from the previous line's. */
function rows(line: Line, before: Line | null): HTMLElement[] {
  const today = day(line.at);
  const head = before && day(before.at) === today ? [] : [h("p", { class: "soft" }, today)];
  const level = line.level === "info" ? null : h("strong", {}, `${line.level}: `);
  const text = h("p", { class: `line is-${line.level}`, "data-line": line.number }, h("time", { datetime: new Date(line.at * 1e3).toISOString() }, clock(line.at)), " ", level, line.text);
  return [...head, text];
}
