// The setup view: files, reading options, subject, and a preview of the tracks over the scene.

import { api, ok } from "../../api/client";
import { ProblemError } from "../../api/problem";
import { h, put } from "../../dom";
import type { Field } from "../../parts/field";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { type Context, link } from "../../view";
import { fileInput } from "./fileInput";
import { parseFile, type ParsedFile } from "./parseFile";
import { readingForm, type ReadingForm } from "./readingForm";
import { SAMPLE_NAME, SAMPLE_NOTE, sampleCsv } from "./sample";
import { requestBody, emptySetup, guessReading, missingInput, type Setup } from "./setup";
import { setupPreview } from "./setupPreview";
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
  let reading: ReadingForm | null = null;
  const [files, readings, subjects, previewPane, problemText] = [h("div", { class: "soft" }), h("div"), h("div"), h("div", { class: "stack" }), h("span", { class: "soft" })];
  const run = h("button", { type: "button", class: "main" }, "Run the diagnosis");
  const updatePreview = (): void => {
    const problem = missingInput(setup);
    run.disabled = problem !== null;
    put(problemText, problem);
    reading?.summarise();
    put(previewPane, ...content(setup, notes, form, trySample, context));
  };
  const form = (): void => {
    const isOpen = readings.querySelector("details")?.open ?? false;
    reading = readingForm(setup, isOpen, updatePreview, form);
    const subjectFields = subjectForm(setup, updatePreview, form, context);
    fields = { ...reading.fields, ...subjectFields.fields };
    put(files, setup.files.length ? fileList(setup) : null);
    refill(readings, reading.element);
    refill(subjects, subjectFields.element);
    readingCard.hidden = !setup.files.length || setup.subject === "job";
    tracksCard.hidden = setup.subject === "job";
    updatePreview();
  };
  const load = async (loaded: ParsedFile[], isSample = false): Promise<void> => {
    context.fail(null);
    const { reading } = emptySetup();
    // New files of the same subject: keep the subject, reset the reading options.
    Object.assign(setup, { files: loaded, columns: null, reading, trial: "", isSample, ...(setup.subject === "ball" ? { ball: { ...setup.ball, floor: null } } : {}) });
    if (setup.subject === "job") setup.subject = "ball";
    notes = guessReading(setup);
    await yieldToBrowser();
    context.say(`${loaded.length === 1 ? loaded[0]!.name : `${loaded.length} files`} loaded. ${notes.join(" ")}`);
    form();
  };
  const trySample = (): void => void load([parseFile(SAMPLE_NAME, sampleCsv())], true).then(() => run.focus(), context.fail);
  const zone = fileInput(place, load, context.fail, context.signal);
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
        showFieldError(e, fields, readings);
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
  const readingCard = card("How the file is read", readings);
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
function showFieldError(error: unknown, fields: Record<string, Field>, readings: HTMLElement): void {
  if (!(error instanceof ProblemError) || !error.problem.field) return;
  const field = fields[error.problem.field];
  if (!field) return;
  const details = readings.querySelector("details");
  if (details?.contains(field.element)) details.open = true;
  field.refuse(error.problem.detail);
  field.input.focus();
}

function fileList(setup: Setup): HTMLElement {
  const names = setup.files.slice(0, 5).map((f) => f.name).join(", ");
  const others = setup.files.length > 5 ? ` and ${setup.files.length - 5} more` : "";
  return h("span", {}, h("strong", {}, names), others);
}

/** The preview, or what to do first. */
function content(setup: Setup, notes: readonly string[], rebuild: () => void, trySample: () => void, context: Context): HTMLElement[] {
  if (setup.subject === "job") return [h("p", { class: "soft" }, "The trials of the estimation are diagnosed with its scene.")];
  if (!setup.files.length && !setup.scene) return [emptyState(trySample)];
  return setupPreview(setup, notes, rebuild, context.say);
}

/** The steps of a diagnosis, and a sample to try it with. */
function emptyState(trySample: () => void): HTMLElement {
  const button = h("button", { type: "button", class: "main" }, "Try with a sample CSV");
  button.addEventListener("click", trySample);
  return h(
    "section",
    { class: "card stack empty-state", "aria-label": "How it works" },
    h("h2", {}, "From tracks to the missing law"),
    h(
      "ol",
      {},
      h("li", {}, "Load the positions of a thrown, falling or bouncing object, as tracked in a video: one row for each frame."),
      h("li", {}, "Check columns, units and floor in the picture."),
      h("li", {}, "Run the diagnosis. It names the effects that the simulation lacks, with their law, size and uncertainty; then play, calibrate and plan with them."),
    ),
    h("pre", { tabindex: 0, "aria-label": "First lines of such a file" }, `${sampleCsv().split("\n", 4).join("\n")}\n…`),
    h("div", { class: "row" }, button, h("span", { class: "soft" }, SAMPLE_NOTE)),
    h("p", { class: "soft" }, "Nothing is sent before you run the diagnosis."),
  );
}
