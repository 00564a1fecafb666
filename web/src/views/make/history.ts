// Undo and redo.

export interface History<T> {
  readonly past: readonly T[];
  readonly present: T;
  readonly future: readonly T[];
  /** Changes with the same key are undone together. */
  readonly key: string | null;
}

/** Maximum number of undo steps. */
const MAX_UNDO_STEPS = 500;

export function begin<T>(present: T): History<T> {
  return { past: [], present: present, future: [], key: null };
}

/** Adds a change. If `key` equals the key of the last change, both become one: a drag, or typing a number. */
export function change<T>(history: History<T>, present: T, key: string | null = null): History<T> {
  if (present === history.present) return history;
  const merges = key !== null && key === history.key;
  const past = merges ? history.past : [...history.past, history.present].slice(-MAX_UNDO_STEPS);
  return { past, present: present, future: [], key };
}

/** Ends the last change: the next one is undone separately. */
export function settle<T>(history: History<T>): History<T> {
  return { ...history, key: null };
}

export function undo<T>(history: History<T>): History<T> {
  const before = history.past.at(-1);
  if (before === undefined) return history;
  return { past: history.past.slice(0, -1), present: before, future: [history.present, ...history.future], key: null };
}

export function redo<T>(history: History<T>): History<T> {
  const [next, ...future] = history.future;
  if (next === undefined) return history;
  return { past: [...history.past, history.present], present: next, future, key: null };
}
