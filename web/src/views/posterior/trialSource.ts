// The measured trials: those of an estimation or a diagnosis, or files.

import type { Schema } from "../../api/client";
import { FileError } from "../../api/problem";
import { h } from "../../dom";
import { choiceField, numberField, numberOf, type RequestField } from "../../parts/requestField";
import { type Job, newestJobs } from "../analysis/kind";
import { readScene } from "../play/taskPicker";
import { diagnosisTrials } from "./diagnosisTrials";

type TrialsIn = Pick<Schema<"PosteriorIn">, "job" | "trials" | "scene" | "ball" | "reading">;

export interface TrialSource {
  main: HTMLElement[];
  more: HTMLElement[];
  fields: RequestField[];
  request: () => Promise<TrialsIn>;
}

const FILES = "files";

/** Fields for the trials; `initial`: id of a job. */
export async function trialSource(initial: string | null, signal: AbortSignal): Promise<TrialSource> {
  const [estimations, diagnoses] = await Promise.all([newestJobs("iplw", signal), newestJobs("diagnose", signal)]);
  const label = (job: Job, kind: string): [string, string] => [job.id, `${job.id}, ${kind} of ${job.name || sourceName(job)}`];
  const options: [string, string][] = [...estimations.map((job) => label(job, "estimation")), ...diagnoses.map((job) => label(job, "diagnosis")), [FILES, "my own files (CSV)…"]];
  const source = choiceField("Measured trials", "job", options, initial, { help: "Trials of an earlier estimation or diagnosis, or files with tracked positions." });
  const files = fileFields();
  const show = (): void => {
    for (const element of [...files.main, ...files.more]) element.hidden = source.input.value !== FILES;
  };
  source.input.addEventListener("change", show);
  show();
  const request = async (): Promise<TrialsIn> => {
    const id = source.input.value;
    if (id === FILES) return files.request();
    return diagnoses.some((job) => job.id === id) ? diagnosisTrials(id, signal) : { job: id };
  };
  return { main: [source.element, ...files.main], more: files.more, fields: [source, ...files.fields], request };
}

function sourceName(job: Job): string {
  const { scene, task } = job.config as { scene?: unknown; task?: string };
  return task ?? (typeof scene === "string" ? scene : "a scene");
}

function fileFields(): TrialSource {
  const input = h("input", { type: "file", accept: ".csv,.tsv,.txt,text/csv,text/plain", multiple: true });
  const sceneInput = h("input", { type: "file", accept: ".json,application/json" });
  const fileRow = (label: string, element: HTMLInputElement, help: string): HTMLElement => h("label", { class: "request-field" }, h("span", {}, label), element, h("span", { class: "help" }, help));
  const radius = numberField("Radius of the ball", "ball.radius", 0.02, { unit: "m", help: "For a single ball. With a scene file the scene describes the bodies." });
  const floor = numberField("Height of the floor", "ball.floor", null, { unit: "m", placeholder: "none", help: "If the ball bounces or rolls: the height of the surface." });
  const lengths = choiceField("Lengths in", "reading.length_unit", [["", "as the file states"], ...["m", "cm", "mm", "in", "ft"].map((u) => [u, u] as const)], "", { help: "If the column names do not state the unit." });
  const fps = numberField("Frames per second", "reading.fps", null, { placeholder: "as the file states", help: "If times are frame numbers." });
  const pixel = numberField("Metres per pixel", "reading.metres_per_pixel", null, { placeholder: "as the file states", help: "If coordinates are in pixels." });
  const request = async (): Promise<TrialsIn> => {
    const list = [...(input.files ?? [])];
    if (!list.length) {
      input.focus();
      throw new FileError("Measured trials", "no file is chosen");
    }
    const texts = await Promise.all(list.map(async (file) => [file.name, await file.text()] as const));
    const entries = { length_unit: lengths.input.value || undefined, fps: numberOf(fps), metres_per_pixel: numberOf(pixel) };
    const reading = Object.fromEntries(Object.entries(entries).filter(([, v]) => v !== undefined));
    const scene = sceneInput.files?.[0];
    const height = numberOf(floor);
    const subject = scene ? { scene: (await readScene(scene)) as unknown as Record<string, never> } : { ball: { radius: numberOf(radius) ?? 0, ...(height === undefined ? {} : { floor: height }) } };
    return { trials: texts.length === 1 ? texts[0]![1] : Object.fromEntries(texts), ...subject, ...(Object.keys(reading).length ? { reading } : {}) };
  };
  const fileElement = fileRow("Files", input, "As written by Tracker, Kinovea or pandas; each of several files is one trial.");
  const sceneElement = fileRow("Scene file", sceneInput, "Instead of a single ball: an iplw.scene/1 document.");
  return { main: [fileElement, radius.element, floor.element], more: [sceneElement, lengths.element, fps.element, pixel.element], fields: [radius, floor, lengths, fps, pixel], request };
}
