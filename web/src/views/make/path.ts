// Paths of fields as the server names them: `bodies[0].shape.radius`. Documents are never changed, only made anew.

/** The steps of a path: names of fields and numbers of items. */
export function keys(path: string): (string | number)[] {
  return [...path.matchAll(/\[(\d+)\]|[^.[\]]+/g)].map((m) => (m[1] === undefined ? m[0] : Number(m[1])));
}

/** What a document has at a path; `undefined` where it ends before. */
export function read(of: unknown, path: string): unknown {
  return keys(path).reduce<unknown>((value, key) => (value as Record<string | number, unknown> | null | undefined)?.[key], of);
}

/** The document with another value at a path; `undefined` takes the field or item away. Everything else is kept. */
export function write<T>(of: T, path: string, value: unknown): T {
  return setAt(of, keys(path), value) as T;
}

/** Whether a path is another one or lies within it. */
export function isWithin(path: string, ancestor: string): boolean {
  if (!path.startsWith(ancestor)) return false;
  const next = path[ancestor.length];
  return next === undefined || next === "." || next === "[";
}

/** Of fields on a form, those that a problem with `named` is about: the field itself, else those within it, else the one it
 * lies within. */
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
  // In its old place, so that a saved file differs only where something was changed.
  return old === undefined ? { ...others, [key]: next } : { ...(of as object), [key]: next };
}
