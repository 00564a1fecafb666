// The source of the worlds in which actions are simulated: the prior, a posterior, an estimation, a scene's effects, or a file.
// The address of the job repeats it, so that its view can simulate in the same worlds.

import { FileError } from "../../api/problem";
import { h, put } from "../../dom";
import { choiceField, type RequestField } from "../../parts/requestField";
import { type Job, jobById, newestJobs } from "./kind";
import { estimatePhysics, type ParameterSamples, type Physics, physicsText, samplesOf } from "./physics";

/** The part of a request that describes the worlds. */
export interface WorldsIn {
  posterior?: Record<string, never>;
  latents?: Physics["latents"];
  effects?: Physics["effects"];
}

export interface SampleSource {
  element: HTMLElement;
  field: RequestField<HTMLSelectElement>;
  request: () => Promise<WorldsIn>;
  /** For the address of the job. */
  query: () => Record<string, string>;
}

const [PRIOR, FILE, SCENE] = ["prior", "file", "scene"];

/** The field; `singleWorlds`: whether a single world is possible, `scene`: that of a scene of another view. */
export async function sampleSource(query: URLSearchParams, singleWorlds: boolean, scene: Physics | null, signal: AbortSignal): Promise<SampleSource> {
  const [posteriors, estimations] = await Promise.all([newestJobs("posterior", signal, "succeeded"), singleWorlds ? newestJobs("iplw", signal, "succeeded") : []]);
  const world = singleWorlds ? (worldOfAddress(query) ?? scene) : null;
  const options: [string, string][] = [
    [PRIOR, "the family's prior: nothing measured yet"],
    ...(world ? [[SCENE, sceneText(world)] as [string, string]] : []),
    ...posteriors.map((job): [string, string] => [job.id, `${job.id}, posterior of ${sourceText(job)}`]),
    ...estimations.map((job): [string, string] => [job.id, `${job.id}, estimate of ${sourceText(job)} (one world)`]),
    [FILE, "a posterior in a file (iplw.posterior/2)…"],
  ];
  const first = query.get("posterior") ?? query.get("estimation") ?? (world ? SCENE : PRIOR);
  const help = singleWorlds ? "The worlds to simulate in. A posterior holds what your trials allow; an estimate is a single world." : "The worlds that are still possible. A posterior holds what your trials allow; the prior is what is known before any trial.";
  const field = choiceField("Parameter samples", "posterior", options, first, { help });
  const file = fileInput();
  const show = (): void => void (file.element.hidden = field.input.value !== FILE);
  field.input.addEventListener("change", show);
  show();
  const isPosterior = (id: string): boolean => posteriors.some((job) => job.id === id);
  const request = async (): Promise<WorldsIn> => {
    const id = field.input.value;
    if (id === PRIOR) return {};
    if (id === SCENE) return world ? sceneRequest(world) : {};
    if (id === FILE) return { posterior: (await file.samples()) as never };
    return isPosterior(id) ? { posterior: samplesOf((await jobById(id, signal)).result) as never } : estimatePhysics(id, signal);
  };
  const address = (): Record<string, string> => {
    const id = field.input.value;
    if (id === PRIOR || id === FILE) return {};
    return id === SCENE ? { world: JSON.stringify(world) } : { [isPosterior(id) ? "posterior" : "estimation"]: id };
  };
  return { element: h("div", { class: "stack" }, field.element, file.element), field, request, query: address };
}

/** The world of a scene in an address. */
export function worldOfAddress(query: URLSearchParams): Physics | null {
  const text = query.get("world");
  return text ? (JSON.parse(text) as Physics) : null;
}

/** Whether a scene's world has latents: then it is a single world, else the prior's worlds get its effects. */
function hasLatents({ latents }: Physics): boolean {
  return Object.keys(latents).length > 0;
}

function sceneText(world: Physics): string {
  return hasLatents(world) ? `the scene's world: ${physicsText(world)}` : `the family's prior, with the scene's effects: ${world.effects.map((e) => e.name.replaceAll("_", " ")).join(", ")}`;
}

function sceneRequest(world: Physics): WorldsIn {
  return hasLatents(world) ? world : { effects: world.effects };
}

function sourceText(job: Job): string {
  const { scene, task, trials } = job.config as { scene?: string; task?: string; trials?: number };
  return [job.name || (scene ?? task ?? "a scene"), trials === undefined ? "" : `${trials} trials`].filter(Boolean).join(", ");
}

function fileInput(): { element: HTMLElement; samples: () => Promise<ParameterSamples> } {
  const input = h("input", { type: "file", accept: ".json,application/json", "aria-label": "Posterior file" });
  const error = h("span", { class: "field-error", role: "alert" });
  input.addEventListener("change", () => put(error));
  const samples = async (): Promise<ParameterSamples> => {
    const file = input.files?.[0];
    if (!file) {
      put(error, "Choose a file.");
      input.focus();
      throw new FileError("Posterior file", "none is chosen");
    }
    const document: unknown = JSON.parse(await file.text().catch(() => "null"));
    if ((document as { format?: string } | null)?.format !== "iplw.posterior/2") throw new FileError(file.name, "it is not an iplw.posterior/2 document");
    return samplesOf(document);
  };
  return { element: h("div", { class: "request-field" }, input, error), samples };
}
