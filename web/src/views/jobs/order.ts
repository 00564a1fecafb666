// Order and selection of the jobs of a page: by a column, by text.

import { durationOf, type Job, kindOf, STATES, subjectOf, titleOf } from "./job";

/** Columns that a list can be sorted by. */
export const COLUMNS = ["name", "kind", "state", "started", "duration", "who", "result"] as const;
export type Column = (typeof COLUMNS)[number];

export interface Order {
  by: Column;
  descending: boolean;
}

/** The server's order: newest first. */
export const NEWEST_FIRST: Order = { by: "started", descending: true };

/** Whether a column is first sorted downwards: numbers are, words are not. */
export function startsDescending(column: Column): boolean {
  return column === "started" || column === "duration";
}

/** The jobs whose name, note, subject or id contains all words of a text. */
export function withText<J extends Job>(jobs: readonly J[], text: string): J[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  return jobs.filter((job) => {
    const all = [titleOf(job), job.note ?? "", subjectOf(job), job.id].join("\n").toLowerCase();
    return words.every((word) => all.includes(word));
  });
}

/** Jobs in an order; jobs without a value are last. */
export function sorted(jobs: readonly Job[], { by, descending }: Order, now = Date.now() / 1e3): Job[] {
  const keyed = jobs.map((job) => ({ job, key: keyOf(job, by, now) }));
  const sign = descending ? -1 : 1;
  keyed.sort((a, b) => {
    if (a.key === null || b.key === null) return Number(a.key === null) - Number(b.key === null) || numberOf(b.job) - numberOf(a.job);
    const difference = typeof a.key === "number" && typeof b.key === "number" ? a.key - b.key : String(a.key).localeCompare(String(b.key), "en", { numeric: true });
    return sign * difference || numberOf(b.job) - numberOf(a.job);
  });
  return keyed.map(({ job }) => job);
}

function keyOf(job: Job, by: Column, now: number): number | string | null {
  switch (by) {
    case "name":
      return titleOf(job).toLowerCase();
    case "kind":
      return kindOf(job);
    case "state":
      return STATES.indexOf(job.state as (typeof STATES)[number]);
    case "started":
      // Jobs that wait in the queue are newer than those that run; without times the number gives the order.
      return job.started ?? job.created ?? numberOf(job);
    case "duration":
      return durationOf(job, now);
    case "who":
      return job.owner ?? null;
    case "result":
      return (job.state === "failed" ? job.error?.detail : job.summary) ?? null;
  }
}

/** Number of a job: 3 for `job-3`. */
function numberOf(job: Job): number {
  return Number(/\d+$/.exec(job.id)?.[0] ?? 0);
}
