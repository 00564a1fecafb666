// From a diagnosis to Play: the extended world, as a launch started.

import { storeScene } from "../../scene/handoff";
import type { Scene } from "../../scene/types";
import { link } from "../../view";
import { extentOfTrials, type Report } from "./report";

/** Leaves a scene for Play and goes there. */
export function openInPlay(scene: Scene, report: Report): void {
  storeScene(scene, extentOfTrials(report));
  location.hash = link("play", ["scene"]);
}
