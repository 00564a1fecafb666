// What is to be diagnosed: the files, how they are read, and what they are of. Kept while other views are looked at.

import type { Schema } from "../../api/client";
import type { Scene } from "../../scene/types";
import { type Columns, type Cut, sent, usual } from "./file";
import { asks, read, type Said, SILENT, touches, type Track, upwards } from "./tracks";

export interface Ball {
  /** m */
  radius: number;
  /** kg */
  mass: number | null;
  /** m/s^2, downwards */
  gravity: number;
  /** Height of the floor's surface, m. */
  floor: number | null;
}

export interface Setup {
  files: Cut[];
  /** Chosen by hand, for files with the columns of the first; `null`: as the server finds them. */
  columns: Columns | null;
  said: Said;
  /** What the tracks are of; of a job, its own trials. */
  of: "ball" | "scene" | "task" | "job";
  ball: Ball;
  /** Of a file or a task. */
  scene: Scene | null;
  sceneName: string;
  job: string;
}

/** A table tennis ball: while a ball flies, its size matters to nothing but a bounce. */
const BALL: Ball = { radius: 0.02, mass: null, gravity: 9.81, floor: null };

export function empty(): Setup {
  return { files: [], columns: null, said: { ...SILENT }, of: "ball", ball: { ...BALL }, scene: null, sceneName: "", job: "" };
}

/** The columns of a file. */
export function columnsOf(setup: Setup, file: Cut): Columns {
  const first = setup.files[0];
  if (setup.columns && file.columns.length === first?.columns.length) return setup.columns;
  return usual(file, setup.said.track, setup.said.metresPerPixel !== null);
}

/** All tracks, as they are read now. */
export function tracksOf(setup: Setup): Track[] {
  return setup.files.flatMap((file) => read(file, columnsOf(setup, file), setup.said));
}

/** What looking at the tracks suggests where nobody said anything: y downwards, a floor. In words, what was set. */
export function guess(setup: Setup): string[] {
  const told: string[] = [];
  const first = setup.files[0];
  if (!first) return told;
  const gravity = setup.ball.gravity;
  const { pixels } = unitsAsked(setup);
  let tracks = tracksOf(setup);
  const up = upwards(tracks);
  // In units of nobody's knowledge only the direction is told.
  if (setup.said.yDown === null && gravity > 0 && up !== null && up > (pixels ? 0 : gravity / 2)) {
    setup.said.yDown = true;
    tracks = tracksOf(setup);
    told.push("y was set to be counted downwards: read upwards, what is thrown would fall up.");
  }
  const scaled = !pixels || setup.said.metresPerPixel !== null;
  const touch = setup.of === "ball" && scaled && setup.ball.floor === null ? touches(tracks) : null;
  if (touch !== null) {
    setup.ball.floor = Number((touch - setup.ball.radius).toFixed(4));
    told.push(`A floor was set at ${setup.ball.floor} m, where the tracks bounce (centre less radius).`);
  }
  return told;
}

/** m of a pixel with which the tracks would fall as gravity has it. */
export function pixelByFall(setup: Setup): number | null {
  const up = upwards(tracksOf({ ...setup, said: { ...setup.said, metresPerPixel: 1, lengthUnit: "" } }));
  return up ? Number((setup.ball.gravity / Math.abs(up)).toPrecision(4)) : null;
}

/** The scene that tracks are drawn over. */
export function sceneOf(setup: Setup): Scene {
  if (setup.of === "scene" || setup.of === "task") return setup.scene ?? { format: "iplw.scene/1", bodies: [] };
  const { radius, floor } = setup.ball;
  const body = { name: "ball", shape: { type: "disc" as const, radius: Math.max(0, radius) } };
  const ground = { name: "floor", shape: { type: "halfspace" as const, normal: [0, 1] as [number, number], offset: floor ?? 0 } };
  return { format: "iplw.scene/1", name: "one ball", bodies: [body], statics: floor === null ? [] : [ground] };
}

/** Whether the size of a pixel, and the number of pictures a second, must be said. */
export function unitsAsked(setup: Setup): { pixels: boolean; pictures: boolean } {
  const first = setup.files[0];
  const own = first ? asks(first, columnsOf(setup, first)) : { pixels: false, pictures: false };
  return { pixels: own.pixels || setup.said.lengthUnit === "px", pictures: own.pictures || setup.said.timeUnit === "frames" };
}

/** Why it cannot be asked for yet; `null` if it can. */
export function missing(setup: Setup): string | null {
  if (setup.of === "job") return setup.job ? null : "Choose an estimation whose trials are to be diagnosed.";
  if (!setup.files.length) return "Drop a CSV of tracks, or choose one.";
  if (setup.of !== "ball" && !setup.scene) return setup.of === "task" ? "Choose a task." : "Open a scene file.";
  const { pixels, pictures } = unitsAsked(setup);
  if (pixels && setup.said.metresPerPixel === null) return "Coordinates are in pixels: say how many metres one is.";
  if (pictures && setup.said.fps === null) return "Times are numbers of pictures: say how many there are in a second.";
  return null;
}

/** The request. */
export function body(setup: Setup): Schema<"DiagnosisIn"> {
  if (setup.of === "job") return { job: setup.job };
  const texts = setup.files.map((file) => [file.name, sent(file, columnsOf(setup, file), setup.said.track)] as const);
  const trials = texts.length === 1 ? texts[0]![1] : Object.fromEntries(texts);
  const reading = readingOf(setup.said);
  const { radius, mass, gravity, floor } = setup.ball;
  const of = setup.of === "ball" ? { ball: { radius, gravity, ...(mass === null ? {} : { mass }), ...(floor === null ? {} : { floor }) } } : { scene: setup.scene as unknown as Record<string, never> };
  return { ...of, trials, ...(Object.keys(reading).length ? { reading } : {}) };
}

/** What was said, as the server takes it. */
export function readingOf(said: Said): Schema<"ReadingIn"> {
  return {
    ...(said.fps === null ? {} : { fps: said.fps }),
    ...(said.metresPerPixel === null ? {} : { metres_per_pixel: said.metresPerPixel }),
    ...(said.lengthUnit && said.lengthUnit !== "px" ? { length_unit: said.lengthUnit } : {}),
    ...(said.timeUnit && said.timeUnit !== "frames" ? { time_unit: said.timeUnit } : {}),
    ...(said.yDown === null ? {} : { y_down: said.yDown }),
    ...(said.track ? { track: said.track } : {}),
  };
}
