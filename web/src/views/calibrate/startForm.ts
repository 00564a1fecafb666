// The form that starts an estimation, with the server's errors at their fields.

import { all, api, ok, type Schema } from "../../api/client";
import { effectLibrary } from "../../api/effects";
import { uniqueId, h, put } from "../../dom";
import type { Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import type { EstimationRequest } from "./estimation";
import { type FormField, field, showFieldError } from "./formField";
import { STRATEGIES } from "./rounds";

/** Options of the form. */
export interface FormChoices {
  families: Schema<"FamilyOut">[];
  worlds: Schema<"WorldOut">[];
  surfaces: Schema<"SurfaceOut">[];
  library: Schema<"EffectOut">[];
  /** A scene to calibrate instead of a task. */
  scene: Scene | null;
}

export async function loadChoices(scene: Scene | null, signal: AbortSignal): Promise<FormChoices> {
  const query = (cursor: string | undefined): { params: { query: { cursor?: string; limit: number } }; signal: AbortSignal } => ({ params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal });
  const [{ families }, worlds, surfaces, library] = await Promise.all([
    ok(api.GET("/v1/tasks", { signal })),
    all((c) => ok(api.GET("/v1/worlds", query(c))), (page) => page.worlds),
    all((c) => ok(api.GET("/v1/surfaces", query(c))), (page) => page.surfaces),
    effectLibrary(signal),
  ]);
  return { families, worlds: worlds.filter((w) => w.kind === "real"), surfaces, library, scene };
}

/** Strategies that use a performance surface. */
const STRATEGIES_WITH_SURFACE = ["gradient", "informative"];
const NEW_WORLD = "";
const ASK_TELL = "ask_tell";
/** Fields that are always visible, those under "More", and those of a new real world. */
const TASK_FIELDS = ["task", "number"];
const MAIN_FIELDS = ["world", "strategy", "surface", "rounds", "actions", "budget"];
const ADVANCED_FIELDS = ["samples", "residual", "fit", "seed"];
const HIDDEN_WORLD_FIELDS = ["real.damping", "real.noise", "real.latents.density", "real.latents.friction", "real.latents.restitution"];

/** The form, filled from another estimation's request; `onStarted` gets the new job. */
export function startForm(of: FormChoices, template: EstimationRequest, onStarted: (job: Schema<"JobOut">) => void, context: Context): HTMLElement {
  const controls = inputs(of, template);
  const fields = labelled(controls);
  const at = (name: string): HTMLElement => fields.get(name)!.element;
  const fieldGroup = (names: readonly string[]): HTMLElement => h("div", { class: "fields" }, ...names.map(at));
  const cost = h("p", { class: "soft", role: "status" });
  const start = h("button", { type: "submit", class: "main" }, "Start");
  const newWorld = h("fieldset", {}, h("legend", {}, "New real world: hidden physics"), fieldGroup(HIDDEN_WORLD_FIELDS));
  const more = h("details", {}, h("summary", {}, "More"), fieldGroup(ADVANCED_FIELDS), newWorld);
  more.open = [template.samples, template.fit, template.seed].some((v) => v !== undefined && v !== null);
  const form = h("form", { class: "card stack", novalidate: true, "aria-label": "Start an estimation" }, h("h2", {}, "Start an estimation"), of.scene ? sceneText(of.scene) : null, fieldGroup([...(of.scene ? [] : TASK_FIELDS), ...MAIN_FIELDS]), more, controls.parameters, cost, h("div", { class: "row" }, start));
  const updateTexts = (): void => {
    put(controls.seeks, `Selects ${STRATEGIES[controls.strategy.value] ?? ""}.`);
    at("surface").hidden = of.scene !== null || !STRATEGIES_WITH_SURFACE.includes(controls.strategy.value);
    newWorld.hidden = controls.real.value !== NEW_WORLD;
    const bound = Math.min((numberValue(controls.rounds) ?? 5) * (numberValue(controls.actions) ?? 10), numberValue(controls.budget) ?? Infinity);
    put(cost, `Spends at most ${bound} real interactions.`);
  };
  controls.task.addEventListener("change", () => fillWorldsAndSurfaces(of, template, controls));
  form.addEventListener("input", updateTexts);
  fillWorldsAndSurfaces(of, template, controls);
  updateTexts();
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    context.fail(null);
    showFieldError(null, fields);
    const invalid = [...fields.values()].find((f) => f.element.querySelector("input")?.validity.badInput);
    if (invalid) return invalid.showError("This is not a number.");
    start.disabled = true;
    ok(api.POST("/v1/iplw", { body: requestBody(controls, of.scene), signal: context.signal }))
      .then(onStarted)
      .catch((e: unknown) => {
        more.open ||= isAdvancedField(e, fields);
        if (!showFieldError(e, fields)) context.fail(e);
      })
      .finally(() => (start.disabled = false));
  });
  return form;
}

type Inputs = ReturnType<typeof inputs>;

/** The inputs, filled from another request. */
function inputs(of: FormChoices, template: EstimationRequest) {
  const number = (value: number | null | undefined, placeholder: string, minimum = 0): HTMLInputElement => h("input", { type: "number", min: minimum, step: "any", value: value ?? "", placeholder });
  const select = (names: readonly string[], selected: string | undefined): HTMLSelectElement => h("select", {}, ...names.map((n) => h("option", { value: n, selected: n === selected }, n)));
  const [family, one] = (template.task ?? of.families[0]?.name ?? "").split(":", 2) as [string, string | undefined];
  const realOptions = typeof template.real === "object" && template.real !== null ? (template.real as Schema<"RealIn">) : {};
  const list = uniqueId("parameters");
  return {
    task: select(of.families.map((f) => f.name), family),
    number: h("input", { type: "number", min: 0, step: 1, value: one ?? "", placeholder: "all for training" }),
    real: h("select", {}),
    strategy: select(Object.keys(STRATEGIES), template.strategy ?? "mixed"),
    /** Text describing the strategy. */
    seeks: h("span"),
    surface: h("select", {}),
    rounds: number(template.rounds, "5", 1),
    actions: number(template.actions, "10", 1),
    budget: number(template.budget, "none", 1),
    samples: number(template.samples, "usual", 4),
    residual: select(["trajectory", "shooting"], template.residual ?? "trajectory"),
    fit: h("input", { type: "text", value: (template.fit ?? []).join(", "), placeholder: "none", list, spellcheck: "false", autocomplete: "off" }),
    parameters: h("datalist", { id: list }, ...of.library.flatMap((e) => e.parameters.map((p) => h("option", { value: `${e.name}.${p.name}` })))),
    seed: number(template.seed, "0"),
    damping: number(realOptions.damping, "the family's"),
    noise: number(realOptions.noise, "0"),
    density: number(realOptions.latents?.density, "the family's"),
    friction: number(realOptions.latents?.friction, "the family's"),
    restitution: number(realOptions.latents?.restitution, "the family's"),
  };
}

/** Fields by their name in the request, each with a sentence of help. */
function labelled(controls: Inputs): Map<string, FormField> {
  return new Map<string, FormField>([
    ["task", field("Family", controls.task, "The kind of task to experiment with.")],
    ["number", field("Task number", controls.number, "One task only; empty for all training tasks.")],
    ["world", field("Real world", controls.real, "Where the experiments are made; every interaction is counted.")],
    ["strategy", field("Strategy", controls.strategy, controls.seeks)],
    ["surface", field("Performance surface", controls.surface, "Determines which latents matter for the task.")],
    ["rounds", field("Maximum rounds", controls.rounds, "Each explores in simulation, measures, and fits.")],
    ["actions", field("Actions per round", controls.actions, "Experiments made before the next fit.")],
    ["budget", field("Maximum real interactions", controls.budget, "Of all rounds together; empty for no limit.")],
    ["samples", field("Samples per iteration", controls.samples, "Fewer are faster but less accurate.")],
    ["residual", field("Residual", controls.residual, "trajectory: from start to end; shooting: in segments, robust to noise and chaos.")],
    ["fit", field("Also fit", controls.fit, "Effect parameters, separated by commas: linear_drag.c")],
    ["seed", field("Seed", controls.seed, "The same seed gives the same result.")],
    ["real.damping", field("Damping, velocity kept per second", controls.damping, "1 keeps all of it.")],
    ["real.noise", field("Observation noise (sd), m", controls.noise, "Added to every measured position.")],
    ["real.latents.density", field("Density, kg/m²", controls.density, "Mass for each area.")],
    ["real.latents.friction", field("Friction", controls.friction, "Coulomb coefficient; 0 for none.")],
    ["real.latents.restitution", field("Restitution", controls.restitution, "Rebound speed over impact speed, 0 to 1.")],
  ]);
}

/** The scene that is calibrated instead of a task. */
function sceneText(scene: Scene): HTMLElement {
  const effects = ((scene.effects as { name: string }[] | undefined) ?? []).map((e) => e.name.replaceAll("_", " "));
  const text = `${scene.name || "Scene"}${effects.length ? `, with ${effects.join(" and ")}` : ""}; actions set ${(scene.action?.components ?? []).map((c) => `${c.target} ${c.set}`).join(", ") || "nothing"}.`;
  return h("p", { class: "calibrated-scene" }, h("strong", {}, "Scene: "), text, " ", h("a", { href: link("calibrate") }, "Choose a task instead"));
}

/** Fills the lists of real worlds and surfaces for the selected family. */
function fillWorldsAndSurfaces(of: FormChoices, template: EstimationRequest, { task, real, surface }: Inputs): void {
  const selectedWorld = real.childElementCount ? real.value : (template.world ?? (template.real === ASK_TELL || (of.scene && !template.real) ? ASK_TELL : NEW_WORLD));
  const worlds = of.worlds.filter((w) => !of.scene && w.task.split(":")[0] === task.value);
  put(real, h("option", { value: NEW_WORLD }, "a new one"), h("option", { value: ASK_TELL }, "your own rig: ask and tell"), ...worlds.map((w) => h("option", { value: w.id }, `${w.id} (${w.interactions} spent)`)));
  real.value = [...real.options].some((o) => o.value === selectedWorld) ? selectedWorld : NEW_WORLD;
  const selectedSurface = surface.childElementCount ? surface.value : (template.surface ?? "");
  const surfaces = of.surfaces.filter((s) => s.task === task.value);
  put(surface, h("option", { value: "" }, "none"), ...surfaces.map((s) => h("option", { value: s.id, selected: s.id === selectedSurface }, s.id)));
}

/** The request. */
function requestBody(controls: Inputs, scene: Scene | null): Schema<"EstimationIn"> {
  const one = controls.number.value.trim();
  const latents = withoutUndefined({ density: numberValue(controls.density), friction: numberValue(controls.friction), restitution: numberValue(controls.restitution) });
  const world = withoutUndefined({ damping: numberValue(controls.damping), noise: numberValue(controls.noise), latents: Object.keys(latents).length ? latents : undefined });
  const fit = controls.fit.value.split(",").map((s) => s.trim()).filter(Boolean);
  const surface = STRATEGIES_WITH_SURFACE.includes(controls.strategy.value) ? controls.surface.value : "";
  const real = controls.real.value === ASK_TELL ? { real: ASK_TELL } : controls.real.value !== NEW_WORLD ? { world: controls.real.value } : Object.keys(world).length ? { real: world } : {};
  return {
    ...(scene ? { scene: scene as unknown as Record<string, never> } : { task: one === "" ? controls.task.value : `${controls.task.value}:${one.padStart(3, "0")}` }),
    strategy: controls.strategy.value,
    residual: controls.residual.value,
    ...withoutUndefined({ rounds: numberValue(controls.rounds), actions: numberValue(controls.actions), samples: numberValue(controls.samples), seed: numberValue(controls.seed), budget: numberValue(controls.budget) }),
    ...(fit.length ? { fit } : {}),
    ...(surface ? { surface } : {}),
    ...real,
  } as Schema<"EstimationIn">;
}

/** Whether an error concerns a field under "More". */
function isAdvancedField(error: unknown, fields: ReadonlyMap<string, FormField>): boolean {
  const copy = new Map([...fields].filter(([, f]) => f.element.closest("details")));
  return showFieldError(error, copy);
}

/** The number entered, if any. */
function numberValue(input: HTMLInputElement): number | undefined {
  return input.value.trim() === "" ? undefined : Number(input.value);
}

function withoutUndefined<T extends Record<string, unknown>>(of: T): { [K in keyof T]?: NonNullable<T[K]> } {
  return Object.fromEntries(Object.entries(of).filter(([, v]) => v !== undefined)) as { [K in keyof T]?: NonNullable<T[K]> };
}
