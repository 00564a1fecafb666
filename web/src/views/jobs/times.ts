// Times of jobs: relative in the text, absolute in the title.

import { hasEnded } from "../../api/jobState";
import { h } from "../../dom";
import { ago, clock, day, duration } from "../../parts/time";
import { durationOf, type Job } from "./job";

const [MINUTE, HOUR, DAY] = [60, 3600, 86_400];

/** A duration with two units: `2 min 5 s`. */
export function exactDuration(seconds: number): string {
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < MINUTE) return `${whole} s`;
  if (whole < HOUR) return `${Math.floor(whole / MINUTE)} min ${whole % MINUTE} s`;
  if (whole < 2 * DAY) return `${Math.floor(whole / HOUR)} h ${Math.floor((whole % HOUR) / MINUTE)} min`;
  return `${Math.floor(whole / DAY)} d ${Math.floor((whole % DAY) / HOUR)} h`;
}

/** A moment, Unix time in s: how long ago, with date and time in the title. */
export function moment(at: number, now = Date.now() / 1e3): HTMLElement {
  const seconds = Math.max(0, now - at);
  const text = seconds < 2 * DAY ? ago(seconds) : `${Math.floor(seconds / DAY)} days ago`;
  return h("time", { datetime: new Date(at * 1e3).toISOString(), title: `${day(at)} ${clock(at)}` }, text);
}

/** Date and time of a moment, Unix time in s. */
export function date(at: number): HTMLElement {
  return h("time", { datetime: new Date(at * 1e3).toISOString() }, `${day(at)} ${clock(at)}`);
}

/** When a job started, or that it waits. */
export function startOf(job: Job): HTMLElement | string {
  if (job.started != null) return moment(job.started);
  return job.created != null ? h("span", { class: "soft" }, "queued ", moment(job.created)) : "–";
}

/** How long a job has run; a running one is rounded to seconds. */
export function runtimeOf(job: Job): string {
  const seconds = durationOf(job);
  if (seconds === null) return "–";
  return hasEnded(job) || seconds >= 10 ? exactDuration(seconds) : `${Math.floor(seconds)} s`;
}

/** Progress of an unfinished job in words: stage, share, time left. */
export function progressText(job: Job): string {
  const { done, total, stage, eta_s: left } = job.progress;
  const parts = [stage || job.state, total > 0 ? `${done} of ${total}` : "", typeof left === "number" ? `${duration(left)} left` : ""];
  return parts.filter(Boolean).join(", ");
}
