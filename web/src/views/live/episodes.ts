// Episodes of a world, from its events: outcome and return of each, and the share of successes over the last ones.

import type { WorldEvent } from "./messages";

export interface Episode {
  /** Number since the page watches, from 1. */
  number: number;
  solved: boolean;
  /** As in Gymnasium: 0 if not solved, else the episode's AUCCESS, 1 at the first attempt. */
  return: number;
}

/** Episodes over which the share of successes is taken. */
export const WINDOW = 20;
/** Maximum number of episodes that are remembered. */
const MAX_EPISODES = 2_000;

export interface EpisodeLog {
  /** Adds an event; returns whether an episode has ended. */
  add: (event: WorldEvent) => boolean;
  episodes: () => readonly Episode[];
}

/** `maxAttempts`: of an episode. */
export function episodeLog(maxAttempts: number): EpisodeLog {
  const episodes: Episode[] = [];
  let [count, attempts, isOpen] = [0, 0, true];
  const end = (solved: boolean): true => {
    count += 1;
    episodes.push({ number: count, solved, return: solved ? auccessOf(attempts, maxAttempts) : 0 });
    if (episodes.length > MAX_EPISODES) episodes.shift();
    [attempts, isOpen] = [0, false];
    return true;
  };
  const add = (event: WorldEvent): boolean => {
    if (event.what === "reset") {
      // An episode with attempts that is reset has ended without success.
      const ended = isOpen && attempts > 0 && end(false);
      [attempts, isOpen] = [0, true];
      return ended;
    }
    if (event.what !== "step" || !event.valid || !isOpen) return false;
    attempts += 1;
    return (event.solved === true || attempts >= maxAttempts) && end(event.solved === true);
  };
  return { add, episodes: () => episodes };
}

/** AUCCESS of an episode of at most `most` attempts, solved at attempt `solvedAt` (Bakhtin et al. 2019, section 4.1). */
export function auccessOf(solvedAt: number, most: number): number {
  return 1 - Math.log(solvedAt) / Math.log(most + 1);
}

/** Share of successes over the last `WINDOW` episodes, after each episode. */
export function successShares(episodes: readonly Episode[]): number[] {
  let solved = 0;
  return episodes.map((episode, i) => {
    solved += Number(episode.solved) - Number(episodes[i - WINDOW]?.solved ?? false);
    return solved / Math.min(i + 1, WINDOW);
  });
}
