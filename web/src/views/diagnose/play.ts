// From a diagnosis to Play: the extended world, as a launch started.

import { storeScene } from "../../scene/handoff";
import type { Scene } from "../../scene/types";
import { link } from "../../view";
import { around, type Report } from "./report";

/** Leaves a scene for Play and goes there. */
export function play(scene: Scene, found: Report): void {
  storeScene(scene, around(found));
  location.hash = link("play", ["scene"]);
}
