// The public API, typed from openapi/openapi.json: `await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } } }))`.

import createClient from "openapi-fetch";
import { ConnectionError, type Problem, ProblemError } from "./problem";
import type { components, paths } from "./schema";
import { markLost } from "./connection";
import { token } from "./token";

/** A type of the API: `Schema<"WorldOut">`. */
export type Schema<K extends keyof components["schemas"]> = components["schemas"][K];

/** Emits `needed` when the server requires a token, or another one. */
export const unauthorized = new EventTarget();

/** All operations by path. */
export const api = createClient<paths>({ fetch: (request) => send(request) });

/** `fetch` with the token; throws `ConnectionError` if there is no response. Aborts are rethrown. */
export async function send(request: Request): Promise<Response> {
  const stored = token();
  if (stored) request.headers.set("Authorization", `Bearer ${stored}`);
  let response: Response;
  try {
    response = await fetch(request);
  } catch (e) {
    if (request.signal.aborted || (e instanceof DOMException && e.name === "AbortError")) throw e;
    markLost();
    throw new ConnectionError();
  }
  if (response.status === 401) unauthorized.dispatchEvent(new Event("needed"));
  return response;
}

/** The data of a response; throws `ProblemError` for an error. */
export async function ok<T>(
  pending: Promise<{ data?: T; error?: unknown; response: Response }>,
): Promise<NonNullable<T>> {
  const { data, error, response } = await pending;
  if (!response.ok) throw new ProblemError(problem(error, response), seconds(response));
  return data as NonNullable<T>;
}

/** All items of a paginated list. */
export async function all<P, T>(page: (cursor: string | undefined) => Promise<P & { next?: string | null }>, items: (page: P) => T[]): Promise<T[]> {
  const collected: T[] = [];
  for (let cursor: string | undefined; ; ) {
    const result = await page(cursor);
    collected.push(...items(result));
    if (!result.next) return collected;
    cursor = result.next;
  }
}

/** The problem in a response; a generic one if the body is not a problem (a proxy's page). */
export function problem(body: unknown, response: Response): Problem {
  if (typeof body === "object" && body !== null && "detail" in body && "type" in body) return body as Problem;
  const detail = `the server responded with status ${response.status} and no explanation`;
  return { type: "about:blank", title: response.statusText || "Error", status: response.status, detail };
}

function seconds(response: Response): number | null {
  const after = Number(response.headers.get("Retry-After") ?? Number.NaN);
  return Number.isFinite(after) ? after : null;
}
