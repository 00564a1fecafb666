// States of jobs.

/** Whether a job has ended, for any reason. */
export function hasEnded({ state }: { readonly state: string }): boolean {
  return ["succeeded", "failed", "cancelled"].includes(state);
}
