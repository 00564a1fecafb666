/** Yields to the browser between two long tasks, so that it can render. */
export function yieldToBrowser(): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, 0));
}
