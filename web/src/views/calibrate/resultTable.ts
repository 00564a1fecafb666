// A table for the measured result of one proposal: one row for each time, two columns for each body. A block copied from a
// spreadsheet can be pasted into any cell.

import type { Schema } from "../../api/client";
import { describeError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";

type Trial = Schema<"TrialIn">;

export interface ResultTable {
  element: HTMLElement;
  /** Adds a row. */
  more: HTMLElement;
  /** The entered values; throws `InvalidCellError` for text that is not a number, displayed at its cell. */
  read: () => Trial;
  /** Displays an error of the server about `trials[0]`; `null` removes it. */
  showError: (error: unknown) => void;
}

/** Initial number of rows. */
const INITIAL_ROWS = 5;

export function resultTable(proposal: number, bodies: readonly string[]): ResultTable {
  const columns: [string, "t" | "x" | "y"][] = [["", "t"], ...bodies.flatMap((b): [string, "x" | "y"][] => [[b, "x"], [b, "y"]])];
  const heads = columns.map(([body, what]) => h("th", { scope: "col" }, what === "t" ? "t, s" : `${body} ${what}, m`));
  const errorId = uniqueId("wrong");
  const errorText = h("p", { id: errorId, class: "why", role: "alert", hidden: true });
  const body = h("tbody");
  const cells = (): HTMLInputElement[][] => [...body.rows].map((r) => [...r.querySelectorAll("input")]);
  const add = (): void => {
    const number = body.rows.length + 1;
    const inputs = columns.map(([of, what]) => {
      const label = what === "t" ? `t, row ${number}` : `${of} ${what}, row ${number}`;
      return h("td", {}, h("input", { type: "text", inputmode: "decimal", "aria-label": label, "aria-describedby": errorId }));
    });
    body.append(h("tr", {}, ...inputs));
  };
  for (let i = 0; i < INITIAL_ROWS; i++) add();
  body.addEventListener("paste", (event) => {
    const block = parseBlock(event.clipboardData?.getData("text") ?? "");
    if (block.length < 2 && (block[0]?.length ?? 0) < 2) return;
    event.preventDefault();
    const all = cells();
    const row = all.findIndex((r) => r.includes(event.target as HTMLInputElement));
    const column = all[row]?.indexOf(event.target as HTMLInputElement) ?? 0;
    while (body.rows.length < row + block.length) add();
    const now = cells();
    block.forEach((line, i) => line.forEach((text, j) => now[row + i]?.[column + j] && (now[row + i]![column + j]!.value = text)));
  });
  const more = h("button", { type: "button" }, "Add a row");
  more.addEventListener("click", add);
  const clear = (): void => {
    errorText.hidden = true;
    for (const cell of cells().flat()) cell.removeAttribute("aria-invalid");
  };
  const markCell = (cell: HTMLInputElement | undefined, text: string): void => {
    errorText.hidden = false;
    put(errorText, text);
    if (cell) set(cell, { "aria-invalid": "true" }).focus();
  };
  /** Rows with at least one value. */
  const filledRows = (): HTMLInputElement[][] => cells().filter((r) => r.some((c) => c.value.trim()));
  const number = (cell: HTMLInputElement): number | null => {
    const text = cell.value.trim().replace(",", ".");
    if (text === "") return null;
    const value = Number(text);
    if (Number.isFinite(value)) return value;
    const problem = `“${cell.value}” is not a number (${cell.getAttribute("aria-label")}).`;
    markCell(cell, problem);
    throw new InvalidCellError(problem);
  };
  const read = (): Trial => {
    clear();
    const rows = filledRows();
    const t = rows.map((r) => {
      const time = number(r[0]!);
      if (time !== null) return time;
      const problem = `Time missing (${r[0]!.getAttribute("aria-label")}).`;
      markCell(r[0], problem);
      throw new InvalidCellError(problem);
    });
    const tracks = bodies.map((b, i) => [b, { x: rows.map((r) => number(r[1 + 2 * i]!)), y: rows.map((r) => number(r[2 + 2 * i]!)) }] as const);
    const observed = tracks.filter(([, track]) => [...track.x, ...track.y].some((v) => v !== null));
    return { proposal, t, bodies: Object.fromEntries(observed) };
  };
  const showError = (error: unknown): void => {
    clear();
    if (error === null || error instanceof InvalidCellError) return;
    const { detail, field } = describeError(error);
    markCell(cellOf(field, filledRows(), bodies), detail);
  };
  const table = h("table", { class: "sheet" }, h("caption", { class: "unseen" }, `Measurements of proposal ${proposal}`), h("thead", {}, h("tr", {}, ...heads)), body);
  return { element: h("div", { class: "stack" }, h("div", { class: "wide" }, table), errorText), more, read, showError: showError };
}

/** An invalid entry; its message is already displayed in the table. */
export class InvalidCellError extends Error {}

/** The cell that a field path of the server refers to. */
function cellOf(field: string | null, rows: HTMLInputElement[][], bodies: readonly string[]): HTMLInputElement | undefined {
  const time = /\.t\[(\d+)\]$/.exec(field ?? "");
  if (time) return rows[Number(time[1])]?.[0];
  const place = /\.bodies\.(.+)\.([xy])\[(\d+)\]$/.exec(field ?? "");
  if (!place) return undefined;
  return rows[Number(place[3])]?.[1 + 2 * bodies.indexOf(place[1]!) + (place[2] === "y" ? 1 : 0)];
}

/** Rows and cells of a block copied from a spreadsheet or a file. */
export function parseBlock(text: string): string[][] {
  const lines = text.trim().split(/\r?\n/);
  const tabs = lines.some((l) => l.includes("\t"));
  const between = tabs ? "\t" : lines.some((l) => l.includes(";")) ? ";" : /\s*,\s*|\s+/;
  return lines.map((l) => l.split(between).map((c) => c.trim()));
}
