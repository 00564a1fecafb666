// Error messages. Problems of the server name the field, its value and what is allowed (RFC 9457).

import type { components } from "./schema";

export type Problem = components["schemas"]["Problem"];

/** A response that is a problem. */
export class ProblemError extends Error {
  constructor(
    readonly problem: Problem,
    /** Seconds to wait before a retry, if the server says. */
    readonly after: number | null = null,
  ) {
    super(problem.detail);
    this.name = "ProblemError";
  }
}

/** No response. */
export class ConnectionError extends Error {
  constructor() {
    super("The server does not respond. The request may not have been executed. The page continues when the server is back.");
    this.name = "GoneError";
  }
}

/** A file with invalid content. */
export class FileError extends Error {
  constructor(
    readonly file: string,
    why: string,
  ) {
    super(why);
    this.name = "FileError";
  }
}

/** Kind of a problem: the last segment of its type. */
export function slug(problem: Problem): string {
  return problem.type.split("/").at(-1) ?? "";
}

/** A message for the user: title and instruction. */
export interface ErrorMessage {
  title: string;
  detail: string;
  /** The field that the server names, if any. */
  field: string | null;
}

/** Message of any error. */
export function describeError(error: unknown): ErrorMessage {
  if (error instanceof ProblemError) {
    const { problem, after } = error;
    const wait = after === null ? "" : ` Try again in ${after} s.`;
    return { title: titleOf(problem), detail: sentence(problem.detail) + wait, field: problem.field ?? null };
  }
  if (error instanceof ConnectionError) return { title: "No connection", detail: error.message, field: null };
  if (error instanceof FileError) return { title: error.file, detail: sentence(error.message), field: null };
  const detail = error instanceof Error ? error.message : String(error);
  return { title: "Error in the page", detail: sentence(detail), field: null };
}

/** Title for a status; default: the server's. */
function titleOf(problem: Problem): string {
  if (problem.status === 401) return "Sign in";
  if (problem.status === 403) return "Not allowed";
  if (problem.status === 429) return "Budget spent or limit reached";
  return problem.title;
}

function sentence(text: string): string {
  const capitalised = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(capitalised) ? capitalised : `${capitalised}.`;
}
