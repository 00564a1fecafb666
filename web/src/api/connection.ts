// Whether the server answers. Once it does not, it is asked for its health until it does.

type Listener = (lost: boolean) => void;

/** Shortest and longest wait between two questions, ms. */
const WAITS = [500, 5_000] as const;

const listeners = new Set<Listener>();
let lost = false;

/** Whether the connection is lost. */
export function isLost(): boolean {
  return lost;
}

/** Calls `listener` when the connection is lost and when it is back; returns what ends that. */
export function watch(listener: Listener): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** A request had no answer. */
export function lose(): void {
  if (lost) return;
  tell(true);
  void ask(WAITS[0]);
}

/** Waits until the server answers. */
export function back(): Promise<void> {
  if (!lost) return Promise.resolve();
  return new Promise((resolve) => {
    const end = watch((now) => {
      if (now) return;
      end();
      resolve();
    });
  });
}

async function ask(wait: number): Promise<void> {
  await new Promise((resolve) => setTimeout(resolve, wait));
  try {
    if ((await fetch("/readyz", { cache: "no-store" })).ok) return tell(false);
  } catch {
    // Asked again below.
  }
  return ask(Math.min(wait * 1.5, WAITS[1]));
}

function tell(now: boolean): void {
  lost = now;
  for (const listener of [...listeners]) listener(now);
}
