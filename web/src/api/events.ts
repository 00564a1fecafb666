// Server-sent events by `fetch`, because `EventSource` cannot send a token. An interrupted stream is resumed after the last
// event, even after a restart of the server.

import { reconnected, markLost } from "./connection";
import { problem, send } from "./client";
import { ConnectionError, ProblemError } from "./problem";

export interface ServerEvent {
  id: string | null;
  event: string;
  data: string;
}

/** Calls `take` with every event of a stream until it ends, the event `last` arrives, or `signal` aborts. */
export async function follow(
  path: string,
  take: (event: ServerEvent) => void,
  signal: AbortSignal,
  last = "done",
): Promise<void> {
  let lastId: string | null = null;
  while (!signal.aborted) {
    try {
      const headers: Record<string, string> = lastId === null ? {} : { "Last-Event-ID": lastId };
      const response = await send(new Request(path, { headers, signal }));
      // 204: no more events.
      if (response.status === 204) return;
      if (!response.ok) throw new ProblemError(problem(await response.json().catch(() => null), response));
      for await (const event of events(response.body!)) {
        lastId = event.id ?? lastId;
        take(event);
        if (event.event === last) return;
      }
      // The server ended the stream early: it is stopping or overloaded.
      await pause(1_000, signal);
    } catch (e) {
      if (signal.aborted) return;
      if (e instanceof ProblemError) throw e;
      if (!(e instanceof ConnectionError)) markLost();
      await reconnected();
    }
  }
}

/** The events of a response body. */
export async function* events(body: ReadableStream<Uint8Array>): AsyncGenerator<ServerEvent> {
  const reader = body.getReader();
  const decoder = new TextDecoder();
  let text = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      text += decoder.decode(value, { stream: true });
      const blocks = text.split(/\r?\n\r?\n/);
      text = blocks.pop() ?? "";
      for (const block of blocks) {
        const event = parseEvent(block);
        if (event) yield event;
      }
    }
  } finally {
    void reader.cancel().catch(() => undefined);
  }
}

/** Parses one block of lines; `null` if it has no data (a keep-alive comment). */
export function parseEvent(block: string): ServerEvent | null {
  const event: ServerEvent = { id: null, event: "message", data: "" };
  const data: string[] = [];
  for (const line of block.split(/\r?\n/)) {
    const colon = line.indexOf(":");
    if (colon === 0) continue;
    const name = colon < 0 ? line : line.slice(0, colon);
    const value = colon < 0 ? "" : line.slice(colon + 1).replace(/^ /, "");
    if (name === "data") data.push(value);
    else if (name === "id") event.id = value;
    else if (name === "event") event.event = value;
  }
  return data.length ? { ...event, data: data.join("\n") } : null;
}

function pause(ms: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve) => {
    const end = setTimeout(resolve, ms);
    signal.addEventListener("abort", () => (clearTimeout(end), resolve()), { once: true });
  });
}
