// A nested configuration as rows of a table, and the differences of two.

/** A row: the path of a value, and its text. */
export interface Setting {
  path: string;
  text: string;
}

/** Difference of two configurations; `null` where a value is not set. */
export interface SettingDifference {
  path: string;
  texts: [string | null, string | null];
}

/** Maximum number of values listed of an array. */
const MAX_LISTED = 8;

/** Readable names of fields of requests. */
const LABELS: Readonly<Record<string, string>> = {
  actions: "actions per round",
  batches: "updates",
  fit: "fitted effects",
  real: "measured in",
  samples: "samples per round",
  split: "tasks",
  attempts: "attempts per task",
  training: "physics in training",
};

/** The values of a configuration by path: `latents friction` for `{latents: {friction: 0.5}}`. */
export function flatten(value: unknown, path: readonly string[] = []): Setting[] {
  const row = (text: string): Setting[] => [{ path: labelOf(path), text }];
  if (value === null || value === undefined) return [];
  if (typeof value !== "object") return row(plain(value));
  if (Array.isArray(value)) return flattenList(value, path, row);
  const of = value as Record<string, unknown>;
  // A scene is one thing: its bodies are in the JSON.
  if (typeof of.format === "string") return row([of.name, of.format].filter((v) => typeof v === "string").join(", "));
  return Object.entries(of).flatMap(([key, v]) => flatten(v, [...path, key]));
}

/** The paths at which two configurations differ, in the order of the first. */
export function differences(one: readonly Setting[], other: readonly Setting[]): { differing: SettingDifference[]; equal: Setting[] } {
  const [a, b] = [new Map(one.map((s) => [s.path, s.text])), new Map(other.map((s) => [s.path, s.text]))];
  const paths = [...new Set([...a.keys(), ...b.keys()])];
  const differing = paths.filter((path) => a.get(path) !== b.get(path)).map((path): SettingDifference => ({ path, texts: [a.get(path) ?? null, b.get(path) ?? null] }));
  return { differing, equal: one.filter((s) => b.get(s.path) === s.text) };
}

function flattenList(list: readonly unknown[], path: readonly string[], row: (text: string) => Setting[]): Setting[] {
  if (!list.length) return [];
  if (list.every((v) => typeof v !== "object" || v === null)) {
    const more = list.length > MAX_LISTED ? `, and ${list.length - MAX_LISTED} more` : "";
    return row(list.slice(0, MAX_LISTED).map(plain).join(", ") + more);
  }
  if (list.length > MAX_LISTED) return row(`${list.length} entries`);
  return list.flatMap((v, i) => {
    // A named entry is found by its name: `effects wind ax`.
    const name = typeof v === "object" && v !== null ? (v as { name?: unknown }).name : undefined;
    const rest = typeof name === "string" ? Object.fromEntries(Object.entries(v as object).filter(([key]) => key !== "name")) : v;
    return flatten(rest, [...path, typeof name === "string" ? name : String(i + 1)]);
  });
}

function labelOf(path: readonly string[]): string {
  return path.map((key, i) => (i === 0 ? (LABELS[key] ?? key) : key).replaceAll("_", " ")).join(" › ");
}

function plain(value: unknown): string {
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "number") return String(Number(value.toPrecision(6)));
  return String(value ?? "none");
}
