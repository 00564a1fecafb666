// The reading options: columns, units, direction of y. Changes are visible in the preview.

import { h } from "../../dom";
import { choice, type Field, numeric, radios } from "../../parts/field";
import { LENGTHS, TIMES } from "./columns";
import { tracks } from "./parseFile";
import { columnsOf, pixelSizeFromGravity, type Setup, unitsNeeded } from "./setup";

export interface ReadingForm {
  element: HTMLElement;
  /** Inputs by the field of the request. */
  fields: Record<string, Field>;
}

/** The fields of a setup; `onChange` is called after every change, `rebuild` after one that affects other fields. */
export function readingForm(setup: Setup, onChange: () => void, rebuild: () => void): ReadingForm {
  const first = setup.files[0];
  if (!first) return { element: h("div"), fields: {} };
  const { reading: options } = setup;
  const selected = columnsOf(setup, first);
  const { pixels, pictures } = unitsNeeded(setup);
  const unitName = (i: number, none: string): string => first.columns[i]?.unit?.name ?? none;
  const length = choice("Lengths in", units(LENGTHS.map(([u]) => u.name), `the file's (${unitName(selected.x, "m")})`), options.lengthUnit, (v) => {
    options.lengthUnit = v;
    options.metresPerPixel = null;
    rebuild();
  });
  const time = choice("Times in", units(TIMES.map(([u]) => u.name), `the file's (${pictures && !options.timeUnit ? "frames" : unitName(selected.clock, "s")})`), options.timeUnit, (v) => {
    options.timeUnit = v;
    options.fps = null;
    rebuild();
  });
  const pixel = numeric("Metres per pixel", "m", options.metresPerPixel, (v) => ((options.metresPerPixel = v), onChange()));
  const fromGravity = h("button", { type: "button" }, "From gravity");
  fromGravity.addEventListener("click", () => {
    options.metresPerPixel = pixelSizeFromGravity(setup);
    rebuild();
  });
  const fps = numeric("Frames per second", "1/s", options.fps, (v) => ((options.fps = v), onChange()));
  const down = radios("y points", [["up", "upwards"], ["down", "downwards, as in images"]], options.yDown ? "down" : "up", (v) => {
    options.yDown = v === "down";
    onChange();
  });
  const trackNames = tracks(first);
  const track = trackNames.length ? choice("Track", [["", "all"], ...trackNames.map((t) => [t, t] as const)], options.track, (v) => ((options.track = v), rebuild())) : null;
  const scale = pixels ? h("div", { class: "row" }, pixel.element, fromGravity) : null;
  const element = h(
    "div",
    { class: "stack" },
    h("div", { class: "fields" }, ...columns(setup, rebuild).map((f) => f.element)),
    h("div", { class: "fields" }, length.element, time.element, track?.element, pictures ? fps.element : null),
    scale,
    down,
  );
  const fields: Record<string, Field> = { "reading.length_unit": length, "reading.time_unit": time, "reading.metres_per_pixel": pixels ? pixel : length, "reading.fps": pictures ? fps : time };
  if (track) fields["reading.track"] = track;
  return { element, fields };
}

const COLUMN_LABELS = { clock: "Time", x: "x", y: "y", trial: "Trial" } as const;

/** Fields that select the columns. */
function columns(setup: Setup, rebuild: () => void): Field[] {
  const first = setup.files[0]!;
  const now = columnsOf(setup, first);
  const names = first.columns.map((c, i) => [String(i), c.name || `column ${i + 1}`] as const);
  return (Object.keys(COLUMN_LABELS) as (keyof typeof COLUMN_LABELS)[]).map((what) => {
    const none = [["-1", what === "trial" ? "one file each" : "none"] as const];
    return choice(COLUMN_LABELS[what], [...none, ...names], String(now[what]), (v) => {
      setup.columns = { ...columnsOf(setup, first), [what]: Number(v) };
      rebuild();
    });
  });
}

function units(names: readonly string[], unitName: string): [string, string][] {
  return [["", unitName], ...names.map((n): [string, string] => [n, n === "px" ? "px (pixels)" : n === "frames" ? "frames" : n])];
}
