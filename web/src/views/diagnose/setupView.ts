// The setup view: files, reading options, subject, and a preview of the tracks over the scene.

import { api, ok } from "../../api/client";
import { ProblemError } from "../../api/problem";
import { h, put } from "../../dom";
import type { Field } from "../../parts/field";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { type Context, link } from "../../view";
import { fileInput } from "./fileInput";
import { readingForm } from "./readingForm";
import { ruler } from "./ruler";
import { requestBody, emptySetup, guessReading, missingInput, sceneOf, type Setup, tracksOf, unitsNeeded } from "./setup";
import { facts, preview } from "./preview";
import { subjectForm } from "./subjectForm";

/** The last setup, restored after a diagnosis was viewed. */
let lastSetup: Setup = emptySetup();

/** Fills a container with the setup view. */
export function setupView(place: HTMLElement, outer: Context): void {
  const abort = new AbortController();
  const context: Context = { ...outer, signal: AbortSignal.any([outer.signal, abort.signal]) };
  const setup = lastSetup;
  let fields: Record<string, Field> = {};
  let notes: string[] = [];
  const [files, readings, subjects, previewPane, problemText] = [h("div", { class: "soft" }), h("div"), h("div"), h("div", { class: "stack" }), h("span", { class: "soft" })];
  const run = h("button", { type: "button", class: "main" }, "Run the diagnosis");
  const updatePreview = (): void => {
    const problem = missingInput(setup);
    run.disabled = problem !== null;
    put(problemText, problem);
    put(previewPane, ...picture(setup, notes, form));
  };
  const form = (): void => {
    const [readingFields, subjectFields] = [readingForm(setup, updatePreview, form), subjectForm(setup, updatePreview, form, context)];
    fields = { ...readingFields.fields, ...subjectFields.fields };
    put(files, setup.files.length ? fileList(setup) : null);
    refill(readings, readingFields.element);
    refill(subjects, subjectFields.element);
    readingCard.hidden = !setup.files.length || setup.subject === "job";
    tracksCard.hidden = setup.subject === "job";
    updatePreview();
  };
  const zone = fileInput(place, async (cuts) => {
    context.fail(null);
    const fresh = emptySetup();
    // New files of the same subject: keep the subject, reset the reading options.
    Object.assign(setup, { files: cuts, columns: null, said: fresh.reading, ...(setup.subject === "ball" ? { ball: { ...setup.ball, floor: null } } : {}) });
    if (setup.subject === "job") setup.subject = "ball";
    notes = guessReading(setup);
    await yieldToBrowser();
    context.say(`${cuts.length === 1 ? cuts[0]!.name : `${cuts.length} files`} read. ${notes.join(" ")}`);
    form();
  }, context.fail, context.signal);
  run.addEventListener("click", () => {
    context.fail(null);
    for (const field of Object.values(fields)) field.refuse(null);
    run.disabled = true;
    put(run, "Sending…");
    ok(api.POST("/v1/diagnoses", { body: requestBody(setup), signal: context.signal }))
      .then((job) => (location.hash = link("diagnose", [job.id])))
      .catch((e: unknown) => {
        put(run, "Run the diagnosis");
        run.disabled = false;
        showFieldError(e, fields);
        context.fail(e);
      });
  });
  const restart = h("button", { type: "button", class: "quiet" }, "Reset");
  restart.addEventListener("click", () => {
    abort.abort();
    lastSetup = emptySetup();
    outer.fail(null);
    setupView(place, outer);
  });
  const tracksCard = card("Tracks", zone, files);
  const readingCard = card("Reading options", readings);
  const subjectCard = card("Recorded object", subjects);
  const controls = h("div", { class: "stack" }, tracksCard, subjectCard, readingCard);
  put(place, h("div", { class: "desk" }, controls, h("div", { class: "stack" }, h("div", { class: "row" }, run, restart, problemText), previewPane)));
  form();
}

function card(title: string, ...content: HTMLElement[]): HTMLElement {
  return h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content);
}

/** Replaces a form and restores the focus. */
function refill(place: HTMLElement, content: HTMLElement): void {
  const inputs = (): HTMLElement[] => [...place.querySelectorAll<HTMLElement>("input, select, button")];
  const focusIndex = inputs().indexOf(document.activeElement as HTMLElement);
  put(place, content);
  if (focusIndex >= 0) inputs()[focusIndex]?.focus();
}

/** Displays an error at the field that it names. */
function showFieldError(error: unknown, fields: Record<string, Field>): void {
  if (!(error instanceof ProblemError) || !error.problem.field) return;
  const field = fields[error.problem.field];
  if (!field) return;
  field.refuse(error.problem.detail);
  field.input.focus();
}

function fileList(setup: Setup): HTMLElement {
  const names = setup.files.slice(0, 5).map((f) => f.name).join(", ");
  const others = setup.files.length > 5 ? ` and ${setup.files.length - 5} more` : "";
  return h("span", {}, h("strong", {}, names), others);
}

/** The tracks over the scene, with a summary. */
function picture(setup: Setup, notes: readonly string[], restart: () => void): HTMLElement[] {
  if (setup.subject === "job") return [h("p", { class: "soft" }, "The trials of the estimation are diagnosed with its scene.")];
  const scene = sceneOf(setup);
  const tracks = tracksOf(setup);
  if (!tracks.length && !setup.scene) return [h("p", { class: "soft" }, setup.files.length ? NOTHING : START)];
  const { pixels } = unitsNeeded(setup);
  const note = pixels && setup.reading.metresPerPixel === null ? "A pixel is drawn as a metre until its size is entered." : "";
  const previewPane = preview(scene, tracks, note);
  const scale = setup.reading.metresPerPixel ?? 1;
  const rulerElement = pixels && scale > 0 ? ruler(previewPane.picture, scale, (v) => ((setup.reading.metresPerPixel = v), restart())) : null;
  return [
    previewPane.element,
    ...(rulerElement ? [rulerElement] : []),
    tracks.length ? facts(tracks, setup.subject === "ball" ? setup.ball.gravity : null) : h("p", { class: "soft" }, setup.files.length ? NOTHING : "Drop a CSV file with tracks."),
    ...notes.map((text) => h("p", { class: "told" }, text)),
  ];
}

const START = "Preview of the tracks over the scene. Nothing is sent before you run the diagnosis.";
const NOTHING = "The selected columns contain no numbers. Choose others, or run the diagnosis to see the server's message.";
