// A scene handed from one view to another ("play in this world"), kept for the tab.

import type { Box, Scene } from "./types";

const [KEY, BOX] = ["iplw-scene", "iplw-scene-box"];

/** Leaves a scene for Play; go to `link("play", ["scene"])` then. `box`: what is to be in sight, where the scene does not tell. */
export function storeScene(scene: Scene, box: Box | null = null): void {
  sessionStorage.setItem(KEY, JSON.stringify(scene));
  sessionStorage.setItem(BOX, JSON.stringify(box));
}

/** What is to be in sight of the scene that was left; `null` if it tells itself. */
export function storedExtent(): Box | null {
  const text = sessionStorage.getItem(BOX);
  return text ? (JSON.parse(text) as Box | null) : null;
}

/** The scene that was left, if there is one. */
export function storedScene(): Scene | null {
  const text = sessionStorage.getItem(KEY);
  return text ? (JSON.parse(text) as Scene) : null;
}
