// Joints: mechanisms with motors, their recordings, and what a simulation of them gets wrong. `#/joints` is the setup,
// `#/joints/job-3` a diagnosis in progress or ended.

import { api, ok, type Schema } from "../api/client";
import { FileError } from "../api/problem";
import { h, put, uniqueId } from "../dom";
import { choice } from "../parts/field";
import { followJob } from "../parts/jobProgress";
import { reportView } from "../parts/reportView";
import { saveFile } from "../parts/share";
import { type Context, link, type View } from "../view";
import { jointForm } from "./joints/jointForm";
import { type Mechanism, mechanismOf, reach } from "./joints/mechanism";
import { mechanismPicture } from "./joints/mechanismPicture";
import { type JointTrial, parseRecording } from "./joints/recording";
import { trialPanel } from "./joints/trialPanel";
import "./joints.css";

export const joints: View = {
  id: "joints",
  title: "Joints",
  about: "Find what a simulation of a robot's joints and motors gets wrong.",
  open: (place, context) => (context.rest[0] ? result(place, context.rest[0], context) : setup(place, context)),
};

/** Choice of a mechanism and a recording. */
async function setup(place: HTMLElement, context: Context): Promise<void> {
  const { tasks } = await ok(api.GET("/v1/control/tasks", { signal: context.signal }));
  let scene = mechanismOf(structuredClone(tasks[0]?.scene));
  let [file, trials]: [{ name: string; text: string } | null, JointTrial[]] = [null, []];
  let panel = new AbortController();
  const [form, pane] = [h("div"), h("div", { class: "stack" })];
  const run = h("button", { type: "button", class: "main" }, "Run the diagnosis");
  const hint = h("span", { class: "soft" });
  const draw = (): void => {
    run.disabled = !scene || !file;
    put(hint, file ? null : "Load a recording first.");
    // The player and the plots of the panel before end.
    panel.abort();
    panel = new AbortController();
    if (!scene) return;
    const signal = AbortSignal.any([context.signal, panel.signal]);
    put(pane, file ? trialPanel(scene, trials, { ...context, signal }) : mechanismPicture(scene, reach(scene, {})).svg);
  };
  const use = (mechanism: Mechanism): void => {
    [scene, file, trials] = [mechanism, null, []];
    put(form, jointForm(mechanism, () => file || draw()));
    draw();
  };
  const task = choice("Mechanism", [...tasks.map((t) => [t.name, t.about] as const), ["", "from a file"]], tasks[0]?.name ?? "", (name) => {
    const mechanism = mechanismOf(structuredClone(tasks.find((t) => t.name === name)?.scene));
    if (mechanism) use(mechanism);
  });
  const openScene = fileButton("Open a scene (JSON)", ".json,application/json", async (name, text) => {
    const mechanism = mechanismOf(parseJson(name, text));
    if (!mechanism) throw new FileError(name, "it is not a scene with joints (iplw.scene/2)");
    task.input.value = "";
    use(mechanism);
  }, context);
  const openRecording = fileButton("Load a recording (CSV)", ".csv,text/csv", async (name, text) => {
    if (!scene) return;
    trials = parseRecording(name, text, scene);
    file = { name, text };
    context.say(`${name} loaded: ${trials.length} trials.`);
    draw();
  }, context);
  run.addEventListener("click", () => {
    if (!scene || !file) return;
    run.disabled = true;
    const body = { scene: scene as never, trials: file.text };
    ok(api.POST("/v1/diagnoses", { body, signal: context.signal }))
      .then((job) => (location.hash = link("joints", [job.id])))
      .catch((e: unknown) => {
        run.disabled = false;
        context.fail(e);
      });
  });
  const save = h("button", { type: "button" }, "Save the scene");
  save.addEventListener("click", () => saveFile("scene.json", "application/json", JSON.stringify(scene, null, 1)));
  const controls = h(
    "div",
    { class: "stack" },
    card("Mechanism", task.element, h("div", { class: "row" }, openScene, save)),
    card("Recording", openRecording, h("p", { class: "soft" }, "One row for each time: trial, t (s), a column for each joint (rad or m), and JOINT.command for each motor.")),
    card("What the simulation assumes", form),
  );
  put(place, h("div", { class: "joints" }, controls, h("div", { class: "stack" }, h("div", { class: "row" }, run, hint), pane)));
  if (scene) use(scene);
}

/** A diagnosis in progress, then its report and what to do next. */
async function result(place: HTMLElement, id: string, context: Context): Promise<void> {
  const job = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal: context.signal }));
  if (job.kind !== "diagnose") throw new Error(`${id} is not a diagnosis; see it under Jobs.`);
  const container = h("div", { class: "stack" });
  put(place, container);
  const links = [h("a", { href: link("joints") }, "Back to the mechanism"), h("a", { href: link("jobs", [id]) }, "The job")];
  const onSuccess = (now: Schema<"JobOut">): void => {
    const extended = h("button", { type: "button", class: "main" }, "Save the extended scene");
    const { extended_scene } = now.result as unknown as { extended_scene: Mechanism };
    extended.addEventListener("click", () => saveFile("extended_scene.json", "application/json", JSON.stringify(extended_scene, null, 1)));
    reportView(id, context.signal)
      .then((report) => put(container, h("div", { class: "row" }, extended, ...links), report))
      .catch(context.fail);
  };
  await followJob(container, job, { subject: "The diagnosis", links }, onSuccess, context);
}

/** A button that opens a file. */
function fileButton(label: string, accept: string, read: (name: string, text: string) => Promise<void>, context: Context): HTMLElement {
  const id = uniqueId("file");
  const input = h("input", { id, type: "file", accept, class: "unseen" });
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    input.value = "";
    context.fail(null);
    file?.text().then((text) => read(file.name, text)).catch(context.fail);
  });
  return h("div", { class: "file" }, input, h("label", { for: id, class: "button" }, label));
}

function parseJson(name: string, text: string): unknown {
  try {
    return JSON.parse(text);
  } catch (e) {
    throw new FileError(name, `it is not JSON: ${(e as Error).message}`);
  }
}

function card(title: string, ...content: HTMLElement[]): HTMLElement {
  return h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content);
}
