// Passes a scene from one view to another, stored for this tab.

import type { Box, Scene } from "./types";

const [KEY, BOX] = ["iplw-scene", "iplw-scene-box"];

/** Stores a scene for Play; then open `link("play", ["scene"])`. `box`: visible box; default: from the scene. */
export function storeScene(scene: Scene, box: Box | null = null): void {
  sessionStorage.setItem(KEY, JSON.stringify(scene));
  sessionStorage.setItem(BOX, JSON.stringify(box));
}

/** The visible box stored with the scene, if any. */
export function storedExtent(): Box | null {
  const text = sessionStorage.getItem(BOX);
  return text ? (JSON.parse(text) as Box | null) : null;
}

/** The stored scene, if any. */
export function storedScene(): Scene | null {
  const text = sessionStorage.getItem(KEY);
  return text ? (JSON.parse(text) as Scene) : null;
}
