// The tracks over the scene before a diagnosis: one trial with its own start among the others, the floor, and a summary.

import { h, put } from "../../dom";
import { choice } from "../../parts/field";
import { allObjects, type Point, type Scene } from "../../scene/types";
import { trialName } from "./trialName";
import { arrows, dotElements, overlay, pathElements } from "./overlay";
import { facts } from "./preview";
import { ruler } from "./ruler";
import { SAMPLE_NOTE } from "./sample";
import { sceneOf, type Setup, tracksOf, unitsNeeded } from "./setup";
import type { Track } from "./tracks";

/** Samples from which the launch velocity is drawn. */
const LAUNCH_SAMPLES = 5;
/** Length of the arrow of the launch velocity, share of the picture. */
const ARROW_SHARE = 0.15;
/** Part of the floor that is visible below its surface, share of the picture. */
const FLOOR_SHARE = 0.04;
const NO_NUMBERS = "The selected columns contain no numbers. Choose others, or run the diagnosis to see the server's message.";

/** The preview; `rebuild` is called after a change of the setup. */
export function setupPreview(setup: Setup, notes: readonly string[], rebuild: () => void, say: (text: string) => void): HTMLElement[] {
  const tracks = tracksOf(setup).filter((t) => t.t.length);
  if (!tracks.length) {
    const text = h("p", { class: "soft" }, setup.files.length ? NO_NUMBERS : "The scene. Load tracks to see them over it.");
    return setup.files.length && !setup.scene ? [text] : [overlay(sceneOf(setup), "The scene", [], []).element, text];
  }
  const place = h("div", { class: "stack" });
  const trials = [...new Set(tracks.map((t) => t.trial))];
  if (!trials.includes(setup.trial)) setup.trial = trials[0]!;
  const show = (): void => void put(place, ...drawing(setup, tracks, rebuild));
  const field = choice("Trial", trials.map((t) => [t, trialName(t)] as const), setup.trial, (v) => ((setup.trial = v), show()));
  const step = (text: string, by: number): HTMLElement => {
    const button = h("button", { type: "button" }, text);
    button.addEventListener("click", () => {
      setup.trial = field.input.value = trials[(trials.indexOf(setup.trial) + by + trials.length) % trials.length]!;
      show();
      say(trialName(setup.trial));
    });
    return button;
  };
  show();
  const gravity = setup.subject === "ball" ? setup.ball.gravity : null;
  return [
    h("div", { class: "row trial-tools" }, field.element, ...(trials.length > 1 ? [step("Previous trial", -1), step("Next trial", 1)] : [])),
    place,
    facts(tracks, gravity),
    ...[...(setup.isSample ? [SAMPLE_NOTE] : []), ...notes, ...floorNote(setup)].map((text) => h("p", { class: "note" }, text)),
  ];
}

/** Tracks over the scene, with the selected trial at its start. */
function drawing(setup: Setup, tracks: readonly Track[], rebuild: () => void): HTMLElement[] {
  const selected = tracks.filter((t) => t.trial === setup.trial);
  const others = tracks.filter((t) => t.trial !== setup.trial);
  const all = tracks.flatMap((t) => t.at);
  const span = extent(all);
  const launches = selected.map(launch);
  const speed = Math.max(...launches.map((l) => Math.hypot(...l.push)), 1e-9);
  const scale = (ARROW_SHARE * span) / speed;
  const tips = launches.map(({ at, push }): Point => [at[0] + scale * push[0], at[1] + scale * push[1]]);
  const elements = [
    pathElements(others.map((t) => t.at), "track other"),
    pathElements(selected.map((t) => t.at), "track"),
    dotElements(selected.flatMap((t) => t.at), "observation"),
    arrows(launches, scale, "arrow launch"),
    dotElements(launches.map((l) => l.at), "track-start"),
  ];
  const { pixels } = unitsNeeded(setup);
  const note = pixels && setup.reading.metresPerPixel === null ? "A pixel is drawn as a metre until its size is entered." : "";
  const scene = sceneAtStart(sceneOf(setup), selected);
  const floor = setup.subject === "ball" ? setup.ball.floor : null;
  const ground: Point[] = floor === null ? [] : [[all[0]![0], floor - FLOOR_SHARE * span]];
  const count = new Set(tracks.map((t) => t.trial)).size;
  const picture = overlay(scene, `${count} tracks over the scene`, [...all, ...tips, ...ground], elements, note);
  const pixelSize = setup.reading.metresPerPixel ?? 1;
  const measure = pixels && pixelSize > 0 ? [ruler(picture.picture, pixelSize, (v) => ((setup.reading.metresPerPixel = v), rebuild()))] : [];
  return [keys(setup, others.length > 0, floor, allObjects(scene).length > scene.bodies.length), picture.element, ...measure];
}

function keys(setup: Setup, hasOthers: boolean, floor: number | null, hasStatics: boolean): HTMLElement {
  const key = (look: string, text: string): HTMLElement => h("span", { class: `key swatch ${look}` }, text);
  return h(
    "div",
    { class: "row keys" },
    key("observed", `${trialName(setup.trial)}, measured`),
    key("launch", "its start and launch velocity"),
    hasOthers ? key("other", "other trials") : null,
    floor !== null ? key("ground", `floor, y = ${floor} m`) : hasStatics ? key("ground", "fixed objects") : null,
  );
}

function floorNote(setup: Setup): string[] {
  const isScaled = !unitsNeeded(setup).pixels || setup.reading.metresPerPixel !== null;
  return setup.subject === "ball" && setup.ball.floor === null && isScaled ? ["No floor: the tracks do not bounce. Add one under “Recorded object” if there was one."] : [];
}

/** The scene with the bodies of a trial where it starts. */
function sceneAtStart(scene: Scene, tracks: readonly Track[]): Scene {
  const start = (name: string): Point | undefined => (tracks.find((t) => t.body === name) ?? (scene.bodies.length === 1 ? tracks[0] : undefined))?.at[0];
  return { ...scene, bodies: scene.bodies.map((b) => ({ ...b, position: start(b.name) ?? b.position ?? null })) };
}

function launch({ t, at }: Track): { at: Point; push: Point } {
  const last = Math.min(LAUNCH_SAMPLES, at.length) - 1;
  const time = t[last]! - t[0]!;
  const velocity = (k: 0 | 1): number => (time > 0 ? (at[last]![k] - at[0]![k]) / time : 0);
  return { at: at[0]!, push: [velocity(0), velocity(1)] };
}

function extent(points: readonly Point[]): number {
  const range = (k: 0 | 1): number => points.reduce((high, p) => Math.max(high, p[k]), -Infinity) - points.reduce((low, p) => Math.min(low, p[k]), Infinity);
  return Math.max(range(0), range(1), 1e-6);
}
