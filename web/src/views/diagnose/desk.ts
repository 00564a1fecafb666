// The desk: files, how they are read, what they are of, and the tracks over the scene as all that makes them.

import { api, ok } from "../../api/client";
import { ProblemError } from "../../api/problem";
import { h, put } from "../../dom";
import type { Field } from "../../parts/field";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { type Context, link } from "../../view";
import { intake } from "./intake";
import { reading } from "./reading";
import { ruler } from "./ruler";
import { body, empty, guess, missing, sceneOf, type Setup, tracksOf, unitsAsked } from "./setup";
import { facts, sight } from "./sight";
import { subject } from "./subject";

/** What was set up last: there again after a diagnosis was looked at. */
let kept: Setup = empty();

/** Fills a place with the desk. */
export function desk(place: HTMLElement, outer: Context): void {
  const own = new AbortController();
  const context: Context = { ...outer, signal: AbortSignal.any([outer.signal, own.signal]) };
  const setup = kept;
  let fields: Record<string, Field> = {};
  let told: string[] = [];
  const [files, readings, subjects, shown, why] = [h("div", { class: "soft" }), h("div"), h("div"), h("div", { class: "stack" }), h("span", { class: "soft" })];
  const run = h("button", { type: "button", class: "main" }, "Run the diagnosis");
  const look = (): void => {
    const lacks = missing(setup);
    run.disabled = lacks !== null;
    put(why, lacks);
    put(shown, ...picture(setup, told, form));
  };
  const form = (): void => {
    const [how, what] = [reading(setup, look, form), subject(setup, look, form, context)];
    fields = { ...how.fields, ...what.fields };
    put(files, setup.files.length ? listed(setup) : null);
    refill(readings, how.element);
    refill(subjects, what.element);
    readingCard.hidden = !setup.files.length || setup.of === "job";
    tracksCard.hidden = setup.of === "job";
    look();
  };
  const zone = intake(place, async (cuts) => {
    context.fail(null);
    const fresh = empty();
    // Another recording of the same thing: what it is of stays, how it is read is told anew.
    Object.assign(setup, { files: cuts, columns: null, said: fresh.said, ...(setup.of === "ball" ? { ball: { ...setup.ball, floor: null } } : {}) });
    if (setup.of === "job") setup.of = "ball";
    told = guess(setup);
    await yieldToBrowser();
    context.say(`${cuts.length === 1 ? cuts[0]!.name : `${cuts.length} files`} read. ${told.join(" ")}`);
    form();
  }, context.fail, context.signal);
  run.addEventListener("click", () => {
    context.fail(null);
    for (const field of Object.values(fields)) field.refuse(null);
    run.disabled = true;
    put(run, "Sending…");
    ok(api.POST("/v1/diagnoses", { body: body(setup), signal: context.signal }))
      .then((job) => (location.hash = link("diagnose", [job.id])))
      .catch((e: unknown) => {
        put(run, "Run the diagnosis");
        run.disabled = false;
        refused(e, fields);
        context.fail(e);
      });
  });
  const again = h("button", { type: "button", class: "quiet" }, "Start anew");
  again.addEventListener("click", () => {
    own.abort();
    kept = empty();
    outer.fail(null);
    desk(place, outer);
  });
  const tracksCard = card("Tracks", zone, files);
  const readingCard = card("How they are read", readings);
  const subjectCard = card("What they are of", subjects);
  const controls = h("div", { class: "stack" }, tracksCard, subjectCard, readingCard);
  put(place, h("div", { class: "desk" }, controls, h("div", { class: "stack" }, h("div", { class: "row" }, run, again, why), shown)));
  form();
}

function card(title: string, ...content: HTMLElement[]): HTMLElement {
  return h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content);
}

/** Replaces a form; the field that had the focus has it again. */
function refill(place: HTMLElement, content: HTMLElement): void {
  const inputs = (): HTMLElement[] => [...place.querySelectorAll<HTMLElement>("input, select, button")];
  const had = inputs().indexOf(document.activeElement as HTMLElement);
  put(place, content);
  if (had >= 0) inputs()[had]?.focus();
}

/** What the server refuses, at the field that it names. */
function refused(error: unknown, fields: Record<string, Field>): void {
  if (!(error instanceof ProblemError) || !error.problem.field) return;
  const field = fields[error.problem.field];
  if (!field) return;
  field.refuse(error.problem.detail);
  field.input.focus();
}

function listed(setup: Setup): HTMLElement {
  const names = setup.files.slice(0, 5).map((f) => f.name).join(", ");
  const more = setup.files.length > 5 ? ` and ${setup.files.length - 5} more` : "";
  return h("span", {}, h("strong", {}, names), more);
}

/** The tracks over the scene, and what they tell at a glance. */
function picture(setup: Setup, told: readonly string[], again: () => void): HTMLElement[] {
  if (setup.of === "job") return [h("p", { class: "soft" }, "An estimation's trials are diagnosed as it measured them, with the scene that it simulates.")];
  const scene = sceneOf(setup);
  const tracks = tracksOf(setup);
  if (!tracks.length && !setup.scene) return [h("p", { class: "soft" }, setup.files.length ? NOTHING : START)];
  const { pixels } = unitsAsked(setup);
  const note = pixels && setup.said.metresPerPixel === null ? "A pixel is drawn as a metre until its size is said." : "";
  const shown = sight(scene, tracks, note);
  const scale = setup.said.metresPerPixel ?? 1;
  const measure = pixels && scale > 0 ? ruler(shown.picture, scale, (v) => ((setup.said.metresPerPixel = v), again())) : null;
  return [
    shown.element,
    ...(measure ? [measure] : []),
    tracks.length ? facts(tracks, setup.of === "ball" ? setup.ball.gravity : null) : h("p", { class: "soft" }, setup.files.length ? NOTHING : "Drop the CSV of the tracks."),
    ...told.map((text) => h("p", { class: "told" }, text)),
  ];
}

const START = "The tracks are drawn here, over the scene, as they will be read. Nothing is sent before you run the diagnosis.";
const NOTHING = "No numbers were found in the chosen columns. Choose others, or run it to hear what the server says of the file.";
