// Parses a file of tracks: header, separator, columns (src/reality/header.rs). Errors are left to the server, which explains
// them.

import { column, type Column, type Quantity } from "./columns";

/** A parsed file. */
export interface ParsedFile {
  name: string;
  text: string;
  /** Lines above the header. */
  linesAbove: number;
  /** A character, or ` ` for white space. */
  separator: string;
  columns: Column[];
  /** Cells of the lines below the header. */
  rows: string[][];
  /** Whether a header with time and a coordinate was found. */
  hasHeader: boolean;
}

/** Column indices; -1 for none. */
export interface ColumnSelection {
  clock: number;
  x: number;
  y: number;
  /** The third coordinate of files with three. */
  z: number;
  trial: number;
  body: number;
}

/** Maximum number of lines above the header. */
const MAX_LINES_ABOVE_HEADER = 50;

/** Parses a file. */
export function parseFile(name: string, text: string): ParsedFile {
  const lines = text.split(/\r\n|\n|\r/);
  let linesAbove: string[] = [];
  for (let i = 0; i < Math.min(lines.length, MAX_LINES_ABOVE_HEADER); i++) {
    const line = lines[i]!.replace(/^\ufeff/, "").replace(/^\s*#\s*/, "");
    if (!line.trim()) continue;
    const separator = separatorOf(line);
    const cells = split(line, separator);
    const columns = cells.map(column);
    const any = (...quantities: Quantity[]): boolean => columns.some((c) => c.quantity && quantities.includes(c.quantity));
    if (any("time", "frame") && any("x", "y")) {
      nameTracks(columns, linesAbove);
      return { name, text, linesAbove: i, separator, columns, rows: rowsBelow(lines, i + 1, separator), hasHeader: true };
    }
    if (!lines[i]!.trimStart().startsWith("#")) linesAbove = cells;
  }
  // No recognised header: the first line with several cells may still be one.
  const first = Math.max(0, lines.findIndex((l) => l.trim() && !l.trim().startsWith("#")));
  const separator = separatorOf(lines[first] ?? "");
  const columns = split(lines[first] ?? "", separator).map(column);
  return { name, text, linesAbove: first, separator, columns, rows: rowsBelow(lines, first + 1, separator), hasHeader: false };
}

/** Default columns, as the server selects them. `track`: which of several. */
export function defaultColumns(of: ParsedFile, track = "", pixels = false): ColumnSelection {
  const at = (...quantities: Quantity[]): number => of.columns.findIndex((c) => c.quantity !== null && quantities.includes(c.quantity));
  const pairs = of.columns.flatMap((c, x) => {
    if (c.quantity !== "x") return [];
    const px = c.unit?.size === null;
    const y = of.columns.findIndex((d) => d.quantity === "y" && d.track === c.track && (d.unit?.size === null) === px);
    return y < 0 ? [] : [{ x, y, px, track: c.track }];
  });
  const matching = pairs.filter((p) => (track && at("body") < 0 ? p.track?.toLowerCase() === track.toLowerCase() : true));
  const unnamed = matching.some((p) => p.track === null) ? matching.filter((p) => p.track === null) : matching;
  const pair = unnamed.find((p) => p.px === pixels) ?? unnamed[0];
  const time = at("time");
  const z = of.columns.findIndex((c) => c.quantity === "z" && c.track === (pair?.track ?? null));
  return { clock: time >= 0 ? time : at("frame"), x: pair?.x ?? at("x"), y: pair?.y ?? at("y"), z, trial: at("trial"), body: at("body") };
}

/** Names of the tracks in a file, if there are several. */
export function tracks(of: ParsedFile): string[] {
  const body = of.columns.findIndex((c) => c.quantity === "body");
  const names = body >= 0 ? of.rows.map((r) => r[body]?.trim() ?? "") : of.columns.filter((c) => c.quantity === "x").map((c) => c.track ?? "");
  const trackNames = [...new Set(names.filter(Boolean))];
  return trackNames.length > 1 ? trackNames : [];
}

/** The text to send: the file's own, or with a header that encodes the selected columns. */
export function textToSend(of: ParsedFile, selected: ColumnSelection, track = ""): string {
  const defaults = defaultColumns(of, track, of.columns[selected.x]?.unit?.size === null);
  if ((Object.keys(defaults) as (keyof ColumnSelection)[]).every((k) => defaults[k] === selected[k])) return of.text;
  const unit = (i: number): string => (of.columns[i]?.unit ? `_${of.columns[i]!.unit!.name}` : "");
  const names = of.columns.map((c, i) => {
    if (i === selected.clock) return c.quantity === "frame" || c.unit?.name === "frames" ? "frame" : `t${unit(i)}`;
    if (i === selected.x) return `x${unit(i)}`;
    if (i === selected.y) return `y${unit(i)}`;
    if (i === selected.z) return `z${unit(i)}`;
    if (i === selected.trial) return "trial";
    if (i === selected.body) return "body";
    return c.quantity === "setting" ? "setting" : `unused${i}`;
  });
  const join = of.separator === " " ? " " : of.separator;
  const lines = of.text.split(/\r\n|\n|\r/);
  return [names.join(join), ...lines.slice(of.linesAbove + 1)].join("\n");
}

/** A number; NaN if missing or invalid. */
export function number(cell: string | undefined): number {
  const text = cell?.trim().replace(",", ".") ?? "";
  return text ? Number(text) : Number.NaN;
}

function separatorOf(line: string): string {
  return ["\t", ";", ","].find((c) => line.includes(c)) ?? " ";
}

/** Cells of a line; quoted cells may contain the separator. */
export function split(line: string, separator: string): string[] {
  if (separator === " ") return line.trim().split(/\s+/);
  if (!line.includes('"')) return line.split(separator);
  const cells: string[] = [""];
  let quoted = false;
  for (const c of line) {
    if (c === '"') quoted = !quoted;
    else if (c === separator && !quoted) cells.push("");
    else cells[cells.length - 1] += c;
  }
  return cells;
}

function rowsBelow(lines: readonly string[], from: number, separator: string): string[][] {
  const rows: string[][] = [];
  for (let i = from; i < lines.length; i++) {
    const line = lines[i]!;
    if (line.trim() && !line.trimStart().startsWith("#")) rows.push(split(line, separator));
  }
  return rows;
}

/** Tracker writes track names above the columns, each above its first. */
function nameTracks(columns: Column[], linesAbove: readonly string[]): void {
  if (columns.filter((c) => c.quantity === "x" && c.track === null).length < 2) return;
  let name: string | null = null;
  columns.forEach((c, i) => {
    name = linesAbove[i]?.trim() || name;
    if ((c.quantity === "x" || c.quantity === "y" || c.quantity === "z") && c.track === null) c.track = name;
  });
}
