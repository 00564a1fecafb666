// Polling while a view is open.

import { reconnected, isLost } from "../api/connection";
import type { Context } from "../view";

/** Calls `update` every `interval` ms; pauses while the page is hidden or the connection is lost. */
export async function poll(update: () => Promise<void>, interval: number, context: Context): Promise<void> {
  while (!context.signal.aborted) {
    await new Promise((resolve) => setTimeout(resolve, interval));
    if (context.signal.aborted) return;
    if (isLost()) {
      await reconnected();
      context.say("The connection is back.");
    }
    if (document.hidden) continue;
    await update().catch((e: unknown) => {
      if (!isLost()) context.fail(e);
    });
  }
}
