// Opens the extended scene in Play.

import { storeScene } from "../../scene/handoff";
import type { Scene } from "../../scene/types";
import { link } from "../../view";
import { extentOfTrials, type Report } from "./report";

/** Stores a scene for Play and opens it. */
export function openInPlay(scene: Scene, report: Report): void {
  storeScene(scene, extentOfTrials(report));
  location.hash = link("play", ["scene"]);
}
