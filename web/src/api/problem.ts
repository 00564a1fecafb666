// What went wrong, in words: the server's own, which name the field, its value and what is allowed (RFC 9457).

import type { components } from "./schema";

export type Problem = components["schemas"]["Problem"];

/** An answer that is a problem. */
export class ProblemError extends Error {
  constructor(
    readonly problem: Problem,
    /** Seconds after which asking again makes sense, where the server says. */
    readonly after: number | null = null,
  ) {
    super(problem.detail);
    this.name = "ProblemError";
  }
}

/** No answer at all. */
export class ConnectionError extends Error {
  constructor() {
    super("The server does not answer. What you asked for was not done, or nobody knows; the page goes on when it is back.");
    this.name = "GoneError";
  }
}

/** A file that somebody chose is not what it has to be. */
export class FileError extends Error {
  constructor(
    readonly file: string,
    why: string,
  ) {
    super(why);
    this.name = "FileError";
  }
}

/** The kind of a problem: the last part of its type. */
export function slug(problem: Problem): string {
  return problem.type.split("/").at(-1) ?? "";
}

/** An error for people: a title, and what to do. */
export interface ErrorMessage {
  title: string;
  detail: string;
  /** The field that the server names, if it does. */
  field: string | null;
}

/** Any error in words. */
export function describeError(error: unknown): ErrorMessage {
  if (error instanceof ProblemError) {
    const { problem, after } = error;
    const wait = after === null ? "" : ` Try again in ${after} s.`;
    return { title: titleOf(problem), detail: sentence(problem.detail) + wait, field: problem.field ?? null };
  }
  if (error instanceof ConnectionError) return { title: "No connection", detail: error.message, field: null };
  if (error instanceof FileError) return { title: error.file, detail: sentence(error.message), field: null };
  const detail = error instanceof Error ? error.message : String(error);
  return { title: "The page failed", detail: sentence(detail), field: null };
}

/** What a status means to who looks at the page; else the server's title. */
function titleOf(problem: Problem): string {
  if (problem.status === 401) return "Sign in";
  if (problem.status === 403) return "Not allowed";
  if (problem.status === 429) return "Nothing left, or too much at a time";
  return problem.title;
}

function sentence(text: string): string {
  const capitalised = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(capitalised) ? capitalised : `${capitalised}.`;
}
