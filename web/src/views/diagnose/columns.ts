// Column names of common tracking programs, as the server recognises them (src/reality/columns.rs); used here only for the
// preview.

export type Quantity = "time" | "frame" | "x" | "y" | "z" | "trial" | "setting" | "body";

/** A unit; `size` in m or s, `null` if only the user knows it (pixels, frames). */
export interface Unit {
  name: string;
  size: number | null;
}

export interface Column {
  /** Name in the file. */
  name: string;
  quantity: Quantity | null;
  unit: Unit | null;
  /** Name of the track: `Ball` for `Ball/0/X`. */
  track: string | null;
}

type Units = readonly (readonly [Unit, readonly string[]])[];
const unit = (name: string, size: number | null, ...names: string[]): readonly [Unit, readonly string[]] => [{ name, size }, [name, ...names]];

export const LENGTHS: Units = [
  unit("m", 1, "metre", "metres", "meter", "meters"),
  unit("cm", 1e-2, "centimetre", "centimetres", "centimeter", "centimeters"),
  unit("mm", 1e-3, "millimetre", "millimetres", "millimeter", "millimeters"),
  unit("um", 1e-6, "µm", "μm"),
  unit("km", 1e3),
  unit("in", 0.0254, "inch", "inches"),
  unit("ft", 0.3048, "foot", "feet"),
  unit("px", null, "pix", "pixel", "pixels"),
];

export const TIMES: Units = [
  unit("s", 1, "sec", "secs", "second", "seconds"),
  unit("ms", 1e-3, "msec", "millisecond", "milliseconds"),
  unit("us", 1e-6, "µs", "μs", "microseconds"),
  unit("min", 60, "minute", "minutes"),
  unit("frames", null, "frame"),
];

const coordinate = (c: string): string[] => [c, `${c}pos`, `pos${c}`, `position${c}`, `${c}position`, `${c}coord`, `${c}coordinate`, `center${c}`, `centre${c}`];
const NAMES: Record<Quantity, string[]> = {
  time: ["t", "time", "times", "timestamp", "elapsed", "elapsedtime", "zeit", "temps"],
  frame: ["frame", "frames", "framenumber", "frameno", "framenr", "frameindex", "frameidx"],
  x: coordinate("x"),
  y: coordinate("y"),
  z: ["z", "zpos", "posz", "positionz", "zposition", "zcoord", "zcoordinate"],
  trial: ["trial", "run", "launch", "throw", "shot", "take", "particle", "track", "trackid"],
  setting: ["setting"],
  body: ["body", "object", "marker"],
};
const inPixels = (c: string): string[] => [`pixel${c}`, `${c}pixel`, `px${c}`, `pix${c}`, `${c}pix`];
const PIXEL = LENGTHS.at(-1)![0];
const SEPARATORS = /[/_ .-]/g;
/** For example, `v_x` is not the x of a track named v. */
const NOT_TRACK_NAMES = new Set("v a p f d vel velocity speed acc accel acceleration momentum force err error std".split(" "));

/** Recognises the quantity of a column from its name. */
export function column(name: string): Column {
  const written = name.trim().replace(/^\ufeff/, "").trim();
  const columnOf = (quantity: Quantity, of: Unit | null, track: string | null = null): Column => ({ name: written, quantity, unit: of, track });
  const [rest, unitOfName] = withoutUnit(written);
  const recognised = quantityNamed(rest);
  if (recognised && unitFits(recognised, unitOfName)) return columnOf(recognised, unitOfName);
  for (const c of ["x", "y"] as const) if (inPixels(c).includes(normalise(rest))) return columnOf(c, PIXEL);
  for (const [time, names] of TIMES.slice(0, 2)) if (names.slice(1).includes(normalise(written))) return columnOf("time", time);
  const separatorAt = lastSeparator(rest);
  if (separatorAt >= 0) {
    const tail = normalise(rest.slice(separatorAt + 1));
    const track = rest.slice(0, separatorAt).replace(/[/_ .-]+$/, "");
    // A single capital letter may be a name.
    const spelt = track.length === 1 ? track : normalise(track);
    if ((tail === "x" || tail === "y" || tail === "z") && unitFits(tail, unitOfName) && !NOT_TRACK_NAMES.has(spelt)) return columnOf(tail, unitOfName, track.trim());
  }
  return { name: written, quantity: null, unit: null, track: null };
}

/** Looks up a unit by name. */
export function unitNamed(units: Units, name: string): Unit | null {
  const normalised = name.trim().toLowerCase();
  return units.find(([, names]) => names.includes(normalised))?.[0] ?? null;
}

/** Splits a unit from a name: `Time (s)`, `X [m]`, `x/m`, `x_px`. */
function withoutUnit(name: string): [string, Unit | null] {
  const recognised = (text: string): Unit | null => unitNamed(LENGTHS, text) ?? unitNamed(TIMES, text);
  const bracketed = /^([^([]*)[([]([^)\]]*)[)\]]$/.exec(name);
  const inside = bracketed && recognised(bracketed[2]!);
  if (inside) return [bracketed[1]!.trim(), inside];
  const separatorAt = lastSeparator(name);
  const tail = separatorAt > 0 ? recognised(name.slice(separatorAt + 1)) : null;
  return tail ? [name.slice(0, separatorAt).trim(), tail] : [name, null];
}

function lastSeparator(name: string): number {
  return Math.max(...["/", "_", " ", ".", "-"].map((c) => name.lastIndexOf(c)));
}

/** Whether a unit matches a quantity. */
function unitFits(quantity: Quantity, of: Unit | null): boolean {
  if (!of) return true;
  const among = (units: Units): boolean => units.some(([u]) => u === of);
  return quantity === "time" ? among(TIMES) : quantity === "x" || quantity === "y" || quantity === "z" ? among(LENGTHS) : false;
}

function quantityNamed(name: string): Quantity | null {
  const normalised = normalise(name);
  const columnOf = Object.entries(NAMES).find(([, names]) => names.includes(normalised));
  return (columnOf?.[0] as Quantity | undefined) ?? null;
}

/** Lower case without separators. */
function normalise(name: string): string {
  return name.replace(SEPARATORS, "").toLowerCase();
}
