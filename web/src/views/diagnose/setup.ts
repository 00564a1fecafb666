// Input of a diagnosis: files, how they are read, and the scene. It is kept while other views are open.

import type { Schema } from "../../api/client";
import type { Scene } from "../../scene/types";
import { type ColumnSelection, type ParsedFile, textToSend, defaultColumns, number } from "./parseFile";
import { unitsUnknown, readTracks, type ReadingOptions, NO_OPTIONS, typicalBounceHeight, type Track, upwardAcceleration } from "./tracks";
import { fallAxis, hasThird } from "./verticalPlane";

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
  files: ParsedFile[];
  /** Columns selected by the user, for files with as many columns as the first; `null`: as the server finds them. */
  columns: ColumnSelection | null;
  reading: ReadingOptions;
  /** The recorded subject: a ball, a scene, a task's scene, or the trials of a job. */
  subject: "ball" | "scene" | "task" | "job";
  ball: Ball;
  /** From a file or a task. */
  scene: Scene | null;
  sceneName: string;
  job: string;
  /** The trial that the preview highlights; empty: the first. */
  trial: string;
  /** Whether the files are the generated sample. */
  isSample: boolean;
}

/** A table tennis ball; the radius matters only for bounces. */
const BALL: Ball = { radius: 0.02, mass: null, gravity: 9.81, floor: null };

export function emptySetup(): Setup {
  return { files: [], columns: null, reading: { ...NO_OPTIONS }, subject: "ball", ball: { ...BALL }, scene: null, sceneName: "", job: "", trial: "", isSample: false };
}

/** The columns of a file. */
export function columnsOf(setup: Setup, file: ParsedFile): ColumnSelection {
  const first = setup.files[0];
  if (setup.columns && file.columns.length === first?.columns.length) return setup.columns;
  return defaultColumns(file, setup.reading.track, setup.reading.metresPerPixel !== null);
}

/** All tracks with the current reading options. */
export function tracksOf(setup: Setup): Track[] {
  return setup.files.flatMap((file) => readTracks(file, columnsOf(setup, file), setup.reading));
}

/** Sets reading options that the data suggest (y downwards, a floor); returns messages about them. */
export function guessReading(setup: Setup): string[] {
  const notes: string[] = [];
  const first = setup.files[0];
  if (!first) return notes;
  const gravity = setup.ball.gravity;
  const [{ pixels }, isSpatial] = [unitsNeeded(setup), hasThreeCoordinates(setup)];
  let tracks = tracksOf(setup);
  const up = upwardAcceleration(tracks);
  // With unknown units only the direction is meaningful.
  if (!isSpatial && setup.reading.yDown === null && gravity > 0 && up !== null && up > (pixels ? 0 : gravity / 2)) {
    setup.reading.yDown = true;
    tracks = tracksOf(setup);
    notes.push("y was set to point downwards, as in images: otherwise the object would fall upwards.");
  }
  const scaled = !pixels || setup.reading.metresPerPixel !== null;
  const contactHeight = setup.subject === "ball" && scaled && setup.ball.floor === null ? typicalBounceHeight(tracks) : null;
  if (contactHeight !== null) {
    setup.ball.floor = Number((contactHeight - setup.ball.radius).toFixed(4));
    notes.push(`A floor was set at y = ${setup.ball.floor} m, where the tracks bounce: the height of the centre there, minus the radius. Clear “There is a floor” if this is wrong.`);
  }
  return notes;
}

/** Whether the first file has three coordinates. */
export function hasThreeCoordinates(setup: Setup): boolean {
  const first = setup.files[0];
  const z = first ? columnsOf(setup, first).z : -1;
  return z >= 0 && hasThird([first!.rows.map((row) => number(row[z]))]);
}

/** The axis along which tracks of three coordinates fall, pointing up; `null` if it is not clear. */
export function fallAxisOf(setup: Setup): string | null {
  const first = setup.files[0];
  if (!first) return null;
  const selected = columnsOf(setup, first);
  const options = { ...setup.reading, yDown: null };
  const flat = readTracks(first, { ...selected, z: -1 }, options);
  const third = readTracks(first, { ...selected, y: selected.z, z: -1 }, options);
  return fallAxis(flat, flat.map(({ at }, i) => at.map(([x, y], k) => [x, y, third[i]?.at[k]?.[1] ?? Number.NaN])));
}

/** Size of a pixel, m, for which the tracks fall with the given gravity. */
export function pixelSizeFromGravity(setup: Setup): number | null {
  const up = upwardAcceleration(tracksOf({ ...setup, reading: { ...setup.reading, metresPerPixel: 1, lengthUnit: "" } }));
  return up ? Number((setup.ball.gravity / Math.abs(up)).toPrecision(4)) : null;
}

/** The scene below the tracks. */
export function sceneOf(setup: Setup): Scene {
  if (setup.subject === "scene" || setup.subject === "task") return setup.scene ?? { format: "iplw.scene/1", bodies: [] };
  const { radius, floor } = setup.ball;
  const body = { name: "ball", shape: { type: "disc" as const, radius: Math.max(0, radius) } };
  const ground = { name: "floor", shape: { type: "halfspace" as const, normal: [0, 1] as [number, number], offset: floor ?? 0 } };
  return { format: "iplw.scene/1", name: "one ball", bodies: [body], statics: floor === null ? [] : [ground] };
}

/** Whether the size of a pixel and the frame rate are required. */
export function unitsNeeded(setup: Setup): { pixels: boolean; pictures: boolean } {
  const first = setup.files[0];
  const needed = first ? unitsUnknown(first, columnsOf(setup, first)) : { pixels: false, pictures: false };
  return { pixels: needed.pixels || setup.reading.lengthUnit === "px", pictures: needed.pictures || setup.reading.timeUnit === "frames" };
}

/** A message about missing input; `null` if the request is complete. */
export function missingInput(setup: Setup): string | null {
  if (setup.subject === "job") return setup.job ? null : "Choose an estimation.";
  if (!setup.files.length) return "Load tracks first.";
  if (setup.subject !== "ball" && !setup.scene) return setup.subject === "task" ? "Choose a task." : "Open a scene file.";
  const { pixels, pictures } = unitsNeeded(setup);
  if (pixels && setup.reading.metresPerPixel === null) return "Coordinates are in pixels: enter metres per pixel.";
  if (pictures && setup.reading.fps === null) return "Times are frame numbers: enter frames per second.";
  return null;
}

/** The request. */
export function requestBody(setup: Setup): Schema<"DiagnosisIn"> {
  if (setup.subject === "job") return { job: setup.job };
  const texts = setup.files.map((file) => [file.name, textToSend(file, columnsOf(setup, file), setup.reading.track)] as const);
  const trials = texts.length === 1 ? texts[0]![1] : Object.fromEntries(texts);
  const reading = readingRequest(setup.reading);
  const { radius, mass, gravity, floor } = setup.ball;
  const subject = setup.subject === "ball" ? { ball: { radius, gravity, ...(mass === null ? {} : { mass }), ...(floor === null ? {} : { floor }) } } : { scene: setup.scene as unknown as Record<string, never> };
  return { ...subject, trials, ...(Object.keys(reading).length ? { reading } : {}) };
}

/** Reading options in the format of the request. */
export function readingRequest(reading: ReadingOptions): Schema<"ReadingIn"> {
  return {
    ...(reading.fps === null ? {} : { fps: reading.fps }),
    ...(reading.metresPerPixel === null ? {} : { metres_per_pixel: reading.metresPerPixel }),
    ...(reading.lengthUnit && reading.lengthUnit !== "px" ? { length_unit: reading.lengthUnit } : {}),
    ...(reading.timeUnit && reading.timeUnit !== "frames" ? { time_unit: reading.timeUnit } : {}),
    ...(reading.up ? { up: reading.up } : {}),
    ...(reading.yDown === null || reading.up ? {} : { y_down: reading.yDown }),
    ...(reading.track ? { track: reading.track } : {}),
  };
}
