// The reading options: columns, units, direction of y. Changes are visible in the preview.

import { h } from "../../dom";
import { choice, type Field, numeric, radios } from "../../parts/field";
import { LENGTHS, TIMES } from "./columns";
import { tracks } from "./parseFile";
import { columnsOf, fallAxisOf, hasThreeCoordinates, missingInput, pixelSizeFromGravity, type Setup, unitsNeeded } from "./setup";
import { readingSummary } from "./readingSummary";
import { UP_AXES } from "./verticalPlane";

export interface ReadingForm {
  element: HTMLElement;
  /** Inputs by the field of the request. */
  fields: Record<string, Field>;
  /** Updates the line that says how the files are read. */
  summarise: () => void;
}

/** How the files are read in one line, and the fields to change it; `onChange` is called after every change, `rebuild` after one
 * that affects other fields. */
export function readingForm(setup: Setup, isOpen: boolean, onChange: () => void, rebuild: () => void): ReadingForm {
  const first = setup.files[0];
  if (!first) return { element: h("div"), fields: {}, summarise: () => undefined };
  const line = h("p", { class: "reading-line", role: "status" });
  const summarise = (): void => void (line.textContent = readingSummary(setup));
  const { element, fields } = optionFields(setup, onChange, rebuild);
  summarise();
  const details = h("details", { open: isOpen || missingInput(setup) !== null || !first.hasHeader }, h("summary", {}, "Change columns, units and directions"), element);
  return { element: h("div", { class: "stack" }, line, details), fields, summarise };
}

function optionFields(setup: Setup, onChange: () => void, rebuild: () => void): Pick<ReadingForm, "element" | "fields"> {
  const first = setup.files[0]!;
  const { reading: options } = setup;
  const selected = columnsOf(setup, first);
  const { pixels, pictures } = unitsNeeded(setup);
  const unitName = (i: number, none: string): string => first.columns[i]?.unit?.name ?? none;
  const length = choice("Lengths in", units(LENGTHS.map(([u]) => u.name), `the file's (${unitName(selected.x, "m")})`), options.lengthUnit, (v) => {
    options.lengthUnit = v;
    options.metresPerPixel = null;
    rebuild();
  }, "Unit of x and y, if the file does not say it.");
  const time = choice("Times in", units(TIMES.map(([u]) => u.name), `the file's (${pictures && !options.timeUnit ? "frames" : unitName(selected.clock, "s")})`), options.timeUnit, (v) => {
    options.timeUnit = v;
    options.fps = null;
    rebuild();
  }, "Seconds, or numbers of frames.");
  const pixel = numeric("Metres per pixel", "m", options.metresPerPixel, (v) => ((options.metresPerPixel = v), onChange()), "Type it, drag along an object of known length in the picture, or take it from the fall.");
  const fromGravity = h("button", { type: "button", title: "The size for which the tracks fall with the gravity entered above" }, "From gravity");
  fromGravity.addEventListener("click", () => {
    options.metresPerPixel = pixelSizeFromGravity(setup);
    rebuild();
  });
  const fps = numeric("Frames per second", "1/s", options.fps, (v) => ((options.fps = v), onChange()), "Of the camera, not of the playback.");
  const trackNames = tracks(first);
  const track = trackNames.length ? choice("Track", [["", "all"], ...trackNames.map((t) => [t, t] as const)], options.track, (v) => ((options.track = v), rebuild()), "Which of the tracked points.") : null;
  const scale = pixels ? h("div", { class: "row scale-row" }, pixel.element, fromGravity) : null;
  const up = upField(setup, onChange, rebuild);
  const element = h(
    "div",
    { class: "stack" },
    h("div", { class: "fields" }, ...columns(setup, rebuild).map((f) => f.element)),
    h("div", { class: "fields" }, length.element, time.element, track?.element, pictures ? fps.element : null),
    scale,
    up.element,
  );
  const fields: Record<string, Field> = { "reading.length_unit": length, "reading.time_unit": time, "reading.metres_per_pixel": pixels ? pixel : length, "reading.fps": pictures ? fps : time };
  if (track) fields["reading.track"] = track;
  if (up.field) fields["reading.up"] = up.field;
  return { element, fields };
}

/** The direction of y, or the axis that points up among three. */
function upField(setup: Setup, onChange: () => void, rebuild: () => void): { element: HTMLElement; field: Field | null } {
  const { reading } = setup;
  if (hasThreeCoordinates(setup)) {
    const options = [["", `the axis of the fall (${fallAxisOf(setup) ?? "not clear"})`], ...UP_AXES.map((a) => [a, a] as const)] as const;
    const field = choice("Up axis", options, reading.up, (v) => ((reading.up = v), rebuild()), "Each trial is projected on its vertical plane.");
    return { element: h("div", { class: "fields" }, field.element), field };
  }
  const down = radios("y points", [["up", "upwards"], ["down", "downwards, as in images"]], reading.yDown ? "down" : "up", (v) => {
    reading.yDown = v === "down";
    onChange();
  });
  return { element: down, field: null };
}

const COLUMN_LABELS = { clock: "Time", x: "x", y: "y", trial: "Trial" } as const;
const COLUMN_HINTS = { clock: "Time or frame number.", x: "Horizontal position.", y: "Vertical position.", trial: "Which throw a row belongs to." } as const;

/** Fields that select the columns. */
function columns(setup: Setup, rebuild: () => void): Field[] {
  const first = setup.files[0]!;
  const now = columnsOf(setup, first);
  const names = first.columns.map((c, i) => [String(i), c.name || `column ${i + 1}`] as const);
  return (Object.keys(COLUMN_LABELS) as (keyof typeof COLUMN_LABELS)[]).map((quantity) => {
    const none = [["-1", quantity === "trial" ? "one file each" : "none"] as const];
    return choice(COLUMN_LABELS[quantity], [...none, ...names], String(now[quantity]), (v) => {
      setup.columns = { ...columnsOf(setup, first), [quantity]: Number(v) };
      rebuild();
    }, COLUMN_HINTS[quantity]);
  });
}

function units(names: readonly string[], unitName: string): [string, string][] {
  return [["", unitName], ...names.map((n): [string, string] => [n, n === "px" ? "px (pixels)" : n === "frames" ? "frames" : n])];
}
