// Requests that follow a hand: one is under way at a time, and after it only what was wanted last.

/** A function that does `work` with the newest value; values that were overtaken are dropped. */
export function latest<T>(work: (value: T) => Promise<void>): (value: T) => void {
  let busy = false;
  let waiting: { value: T } | null = null;
  const run = async (first: T): Promise<void> => {
    busy = true;
    try {
      for (let next: { value: T } | null = { value: first }; next; ) {
        waiting = null;
        await work(next.value);
        next = waiting;
      }
    } finally {
      busy = false;
    }
  };
  return (value) => {
    if (busy) waiting = { value };
    else void run(value);
  };
}
