/** Lets something else be drawn: between two pieces of work that together would be seen as a stutter. */
export function yieldToBrowser(): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, 0));
}
