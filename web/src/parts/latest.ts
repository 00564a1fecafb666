// Rate limiting of requests: one at a time, then only the latest value.

/** A function that calls `work` with the latest value; intermediate values are dropped. */
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
