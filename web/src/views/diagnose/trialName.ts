// Names of trials.

/** Name of a trial as the user wrote it; a bare number is preceded by a noun. */
export function trialName(name: string): string {
  return /^\d+$/.test(name) ? `Trial ${name}` : name;
}
