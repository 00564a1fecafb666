// State of the connection. While it is lost, the server's health is polled.

type Listener = (lost: boolean) => void;

/** Minimum and maximum polling interval, ms. */
const RETRY_MS = [500, 5_000] as const;

const listeners = new Set<Listener>();
let lost = false;

/** Whether the connection is lost. */
export function isLost(): boolean {
  return lost;
}

/** Calls `listener` when the connection is lost and when it is back; returns a function that removes it. */
export function onConnectionChange(listener: Listener): () => void {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

/** Reports a request without response. */
export function markLost(): void {
  if (lost) return;
  notify(true);
  void checkHealth(RETRY_MS[0]);
}

/** Waits until the server responds. */
export function reconnected(): Promise<void> {
  if (!lost) return Promise.resolve();
  return new Promise((resolve) => {
    const end = onConnectionChange((now) => {
      if (now) return;
      end();
      resolve();
    });
  });
}

async function checkHealth(wait: number): Promise<void> {
  await new Promise((resolve) => setTimeout(resolve, wait));
  try {
    if ((await fetch("/readyz", { cache: "no-store" })).ok) return notify(false);
  } catch {
    // Retried below.
  }
  return checkHealth(Math.min(wait * 1.5, RETRY_MS[1]));
}

function notify(now: boolean): void {
  lost = now;
  for (const listener of [...listeners]) listener(now);
}
