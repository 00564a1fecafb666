// What was drawn before, for undo and redo.

export interface History<T> {
  readonly past: readonly T[];
  readonly now: T;
  readonly future: readonly T[];
  /** What the last change belongs to: changes with the same key are undone together. */
  readonly key: string | null;
}

/** Changes that are kept; older ones cannot be undone. */
const KEPT = 500;

export function begin<T>(now: T): History<T> {
  return { past: [], now, future: [], key: null };
}

/** One change more. With a `key` that is also the last change's it becomes one with it: a drag, or a number being typed. */
export function change<T>(history: History<T>, now: T, key: string | null = null): History<T> {
  if (now === history.now) return history;
  const joins = key !== null && key === history.key;
  const past = joins ? history.past : [...history.past, history.now].slice(-KEPT);
  return { past, now, future: [], key };
}

/** The last change is over: the next one is undone by itself. */
export function settle<T>(history: History<T>): History<T> {
  return { ...history, key: null };
}

export function undo<T>(history: History<T>): History<T> {
  const before = history.past.at(-1);
  if (before === undefined) return history;
  return { past: history.past.slice(0, -1), now: before, future: [history.now, ...history.future], key: null };
}

export function redo<T>(history: History<T>): History<T> {
  const [next, ...future] = history.future;
  if (next === undefined) return history;
  return { past: [...history.past, history.now], now: next, future, key: null };
}
