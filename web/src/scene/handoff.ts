// A scene handed from one view to another ("play in this world"), kept for the tab.

import type { Scene } from "./types";

const KEY = "iplw-scene";

/** Leaves a scene for Play; go to `link("play", ["scene"])` then. */
export function give(scene: Scene): void {
  sessionStorage.setItem(KEY, JSON.stringify(scene));
}

/** The scene that was left, if there is one. */
export function left(): Scene | null {
  const text = sessionStorage.getItem(KEY);
  return text ? (JSON.parse(text) as Scene) : null;
}
