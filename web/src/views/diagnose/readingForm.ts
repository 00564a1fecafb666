// How files are read: columns, units, which way y points. What a field changes is seen in the picture beside it.

import { h } from "../../dom";
import { choice, type Field, numeric, radios } from "../../parts/field";
import { LENGTHS, TIMES } from "./columns";
import { tracks } from "./parseFile";
import { columnsOf, pixelSizeFromGravity, type Setup, unitsNeeded } from "./setup";

export interface Reading {
  element: HTMLElement;
  /** Inputs by the field of the request. */
  fields: Record<string, Field>;
}

/** The fields of a setup; `changed` after every change, `again` after one that other fields depend on. */
export function readingForm(setup: Setup, changed: () => void, again: () => void): Reading {
  const first = setup.files[0];
  if (!first) return { element: h("div"), fields: {} };
  const { reading: said } = setup;
  const chosen = columnsOf(setup, first);
  const { pixels, pictures } = unitsNeeded(setup);
  const own = (i: number, none: string): string => first.columns[i]?.unit?.name ?? none;
  const length = choice("Lengths in", units(LENGTHS.map(([u]) => u.name), `the file's (${own(chosen.x, "m")})`), said.lengthUnit, (v) => {
    said.lengthUnit = v;
    said.metresPerPixel = null;
    again();
  });
  const time = choice("Times in", units(TIMES.map(([u]) => u.name), `the file's (${pictures && !said.timeUnit ? "frames" : own(chosen.clock, "s")})`), said.timeUnit, (v) => {
    said.timeUnit = v;
    said.fps = null;
    again();
  });
  const pixel = numeric("Metres per pixel", "m", said.metresPerPixel, (v) => ((said.metresPerPixel = v), changed()));
  const fall = h("button", { type: "button" }, "As gravity has it");
  fall.addEventListener("click", () => {
    said.metresPerPixel = pixelSizeFromGravity(setup);
    again();
  });
  const fps = numeric("Pictures a second", "1/s", said.fps, (v) => ((said.fps = v), changed()));
  const down = radios("y is counted", [["up", "upwards"], ["down", "downwards, as in pictures"]], said.yDown ? "down" : "up", (v) => {
    said.yDown = v === "down";
    changed();
  });
  const several = tracks(first);
  const track = several.length ? choice("Track", [["", "all"], ...several.map((t) => [t, t] as const)], said.track, (v) => ((said.track = v), again())) : null;
  const scale = pixels ? h("div", { class: "row" }, pixel.element, fall) : null;
  const element = h(
    "div",
    { class: "stack" },
    h("div", { class: "fields" }, ...columns(setup, again).map((f) => f.element)),
    h("div", { class: "fields" }, length.element, time.element, track?.element, pictures ? fps.element : null),
    scale,
    down,
  );
  const fields: Record<string, Field> = { "reading.length_unit": length, "reading.time_unit": time, "reading.metres_per_pixel": pixels ? pixel : length, "reading.fps": pictures ? fps : time };
  if (track) fields["reading.track"] = track;
  return { element, fields };
}

const WORDS = { clock: "Time", x: "x", y: "y", trial: "Launch" } as const;

/** Which columns hold what. */
function columns(setup: Setup, again: () => void): Field[] {
  const first = setup.files[0]!;
  const now = columnsOf(setup, first);
  const names = first.columns.map((c, i) => [String(i), c.name || `column ${i + 1}`] as const);
  return (Object.keys(WORDS) as (keyof typeof WORDS)[]).map((what) => {
    const none = [["-1", what === "trial" ? "a file each" : "none"] as const];
    return choice(WORDS[what], [...none, ...names], String(now[what]), (v) => {
      setup.columns = { ...columnsOf(setup, first), [what]: Number(v) };
      again();
    });
  });
}

function units(names: readonly string[], own: string): [string, string][] {
  return [["", own], ...names.map((n): [string, string] => [n, n === "px" ? "px (pixels)" : n === "frames" ? "frames (pictures)" : n])];
}
