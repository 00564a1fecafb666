// Readable times.

/** A readable duration. */
export function duration(seconds: number): string {
  if (seconds < 90) return `${Math.max(1, Math.round(seconds))} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${Math.round(seconds / 3600)} h`;
}

/** Elapsed time; coarse, so that lists do not change at every update. */
export function ago(seconds: number): string {
  if (seconds < 10) return "now";
  if (seconds < 90) return `${Math.floor(seconds / 10) * 10} s ago`;
  return `${duration(seconds)} ago`;
}

/** The time of day of a moment, s since 1970. */
export function clock(at: number): string {
  const date = new Date(at * 1e3);
  const two = (n: number): string => String(n).padStart(2, "0");
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}`;
}

/** The day of a moment, s since 1970. */
export function day(at: number): string {
  const date = new Date(at * 1e3);
  const two = (n: number): string => String(n).padStart(2, "0");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
}
