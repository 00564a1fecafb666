// The subject of the tracks: a single ball, a scene file, a task's scene, or the trials of an estimation.

import { api, ok, type Schema } from "../../api/client";
import { uniqueId, h, put } from "../../dom";
import { choice, type Field, numeric, radios } from "../../parts/field";
import type { Context } from "../../view";
import { loadTask, readScene } from "../play/taskPicker";
import type { Setup } from "./setup";

export interface SubjectForm {
  element: HTMLElement;
  fields: Record<string, Field>;
}

/** The fields; `onChange` is called after every change, `rebuild` after one that affects other fields. */
export function subjectForm(setup: Setup, onChange: () => void, rebuild: () => void, context: Context): SubjectForm {
  const kinds = [["ball", "a single ball"], ["scene", "a scene file"], ["task", "a task's scene"], ["job", "an estimation's trials"]] as const;
  const kind = radios("What was filmed?", kinds, setup.subject, (v) => {
    setup.subject = v as Setup["subject"];
    [setup.scene, setup.sceneName] = [null, ""];
    rebuild();
  });
  if (setup.subject === "ball") {
    const { element, fields } = ball(setup, onChange, rebuild);
    return { element: h("div", { class: "stack" }, kind, element), fields };
  }
  const choices = setup.subject === "scene" ? file(setup, rebuild, context) : setup.subject === "task" ? task(setup, rebuild, context) : jobs(setup, onChange, context);
  return { element: h("div", { class: "stack" }, kind, choices), fields: {} };
}

function ball(setup: Setup, onChange: () => void, rebuild: () => void): SubjectForm {
  const { ball } = setup;
  const radius = numeric("Radius", "m", ball.radius, (v) => v !== null && ((ball.radius = v), onChange()), "Matters only for bounces.");
  const mass = numeric("Mass, if known", "kg", ball.mass, (v) => ((ball.mass = v), onChange()), "Leave it empty if unknown.");
  const gravity = numeric("Gravity", "m/s²", ball.gravity, (v) => v !== null && ((ball.gravity = v), onChange()), "Downwards; 0 for a view from above.");
  const floor = numeric("Floor height", "m", ball.floor, (v) => ((ball.floor = v), onChange()), "Of its surface, in the coordinates of the tracks.");
  const hasFloor = h("input", { type: "checkbox", checked: ball.floor !== null });
  hasFloor.addEventListener("change", () => ((ball.floor = hasFloor.checked ? 0 : null), rebuild()));
  const ground = h("div", { class: "row ground" }, h("label", { class: "radio" }, hasFloor, "There is a floor"), ball.floor === null ? null : floor.element);
  const element = h("div", { class: "stack" }, h("div", { class: "fields" }, radius.element, mass.element, gravity.element), ground);
  return { element, fields: { "ball.radius": radius, "ball.mass": mass, "ball.gravity": gravity, ...(ball.floor === null ? {} : { "ball.floor": floor }) } };
}

function file(setup: Setup, rebuild: () => void, context: Context): HTMLElement {
  const id = uniqueId("scene");
  const input = h("input", { id, type: "file", accept: ".json,application/json", class: "unseen" });
  input.addEventListener("change", () => {
    const one = input.files?.[0];
    if (!one) return;
    context.fail(null);
    readScene(one)
      .then((scene) => {
        [setup.scene, setup.sceneName] = [scene, scene.name || one.name];
        rebuild();
      })
      .catch(context.fail);
    input.value = "";
  });
  return h("div", { class: "row file" }, input, h("label", { for: id, class: "button" }, "Open a scene file"), h("strong", {}, setup.sceneName));
}

function task(setup: Setup, rebuild: () => void, context: Context): HTMLElement {
  const place = h("div", { class: "row" });
  const pick = async (id: string): Promise<void> => {
    const { scene } = await loadTask(id, context.signal);
    [setup.scene, setup.sceneName] = [scene, id];
    rebuild();
  };
  const fill = async (): Promise<void> => {
    const { families } = await ok(api.GET("/v1/tasks", { signal: context.signal }));
    const ids = families.flatMap((f) => Array.from({ length: f.tasks }, (_, i) => `${f.name}:${String(i).padStart(3, "0")}`));
    const field = choice("Task", [["", "choose"], ...ids.map((t) => [t, t] as const)], setup.sceneName, (v) => void (v && pick(v).catch(context.fail)));
    put(place, field.element);
  };
  fill().catch(context.fail);
  return place;
}

/** Maximum number of estimations read, newest first, and listed. */
const [MAX_JOBS_READ, MAX_JOBS_LISTED] = [200, 20];

function jobs(setup: Setup, onChange: () => void, context: Context): HTMLElement {
  const place = h("div", { class: "row" });
  const fill = async (): Promise<void> => {
    const choices = await estimations(context.signal);
    if (!choices.length) return void put(place, h("p", { class: "soft" }, "There is no estimation with trials yet. Start one under Calibrate."));
    const field = choice("Estimation", [["", "choose"], ...choices.map((job) => [job.id, jobLabel(job)] as const)], setup.job, (v) => ((setup.job = v), onChange()), "Its trials are compared with its scene.");
    put(place, field.element);
  };
  fill().catch(context.fail);
  return place;
}

/** Estimations that may have trials, newest first. */
async function estimations(signal: AbortSignal): Promise<Schema<"JobOut">[]> {
  const query = { kind: "iplw", order: "newest", results: false, limit: MAX_JOBS_READ };
  const { jobs } = await ok(api.GET("/v1/jobs", { params: { query }, signal }));
  return jobs.filter((job) => job.state !== "queued" && job.state !== "failed").slice(0, MAX_JOBS_LISTED);
}

function jobLabel(job: Schema<"JobOut">): string {
  const task = (job.config as Record<string, unknown>).task;
  return `${job.id}${typeof task === "string" ? `: ${task}` : ""} (${job.state})`;
}
