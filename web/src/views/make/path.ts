// Field paths as the server names them: `bodies[0].shape.radius`. Documents are immutable.

/** The keys of a path: field names and indices. */
export function keys(path: string): (string | number)[] {
  return [...path.matchAll(/\[(\d+)\]|[^.[\]]+/g)].map((m) => (m[1] === undefined ? m[0] : Number(m[1])));
}

/** The value at a path; `undefined` if it does not exist. */
export function read(of: unknown, path: string): unknown {
  return keys(path).reduce<unknown>((value, key) => (value as Record<string | number, unknown> | null | undefined)?.[key], of);
}

/** A copy with another value at a path; `undefined` removes the field or item. */
export function write<T>(of: T, path: string, value: unknown): T {
  return setAt(of, keys(path), value) as T;
}

/** Whether a path equals another or lies within it. */
export function isWithin(path: string, ancestor: string): boolean {
  if (!path.startsWith(ancestor)) return false;
  const next = path[ancestor.length];
  return next === undefined || next === "." || next === "[";
}

/** The form fields that a problem at `path` concerns: that field, else the fields within it, else the closest one around it. */
export function affectedFields(fields: readonly string[], path: string): string[] {
  const same = fields.filter((f) => f === path);
  if (same.length) return same;
  const below = fields.filter((f) => isWithin(f, path));
  if (below.length) return below;
  const above = fields.filter((f) => isWithin(path, f)).sort((a, b) => b.length - a.length);
  return above.slice(0, 1);
}

function setAt(of: unknown, [key, ...rest]: (string | number)[], value: unknown): unknown {
  if (key === undefined) return value;
  if (typeof key === "number") {
    const list = Array.isArray(of) ? [...of] : [];
    const next = setAt(list[key], rest, value);
    if (next === undefined) list.splice(key, 1);
    else list[key] = next;
    return list;
  }
  const { [key]: old, ...others } = (of ?? {}) as Record<string, unknown>;
  const next = setAt(old, rest, value);
  if (next === undefined) return others;
  // Keep the order of fields, so that a saved file differs only where something changed.
  return old === undefined ? { ...others, [key]: next } : { ...(of as object), [key]: next };
}
