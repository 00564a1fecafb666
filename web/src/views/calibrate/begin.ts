// The form that starts an estimation; errors of the server's stand at the field that they name.

import { all, api, ok, type Schema } from "../../api/client";
import { uniqueId, h, put } from "../../dom";
import type { Context } from "../../view";
import type { Asked } from "./course";
import { type Field, field, refused } from "./field";
import { STRATEGIES } from "./proposed";

/** What a form is filled from. */
export interface Choices {
  families: Schema<"FamilyOut">[];
  worlds: Schema<"WorldOut">[];
  surfaces: Schema<"SurfaceOut">[];
  library: Schema<"EffectOut">[];
}

export async function choices(signal: AbortSignal): Promise<Choices> {
  const query = (cursor: string | undefined): { params: { query: { cursor?: string; limit: number } }; signal: AbortSignal } => ({ params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal });
  const [{ families }, worlds, surfaces, library] = await Promise.all([
    ok(api.GET("/v1/tasks", { signal })),
    all((c) => ok(api.GET("/v1/worlds", query(c))), (page) => page.worlds),
    all((c) => ok(api.GET("/v1/surfaces", query(c))), (page) => page.surfaces),
    all((c) => ok(api.GET("/v1/effects", query(c))), (page) => page.effects),
  ]);
  return { families, worlds: worlds.filter((w) => w.kind === "real"), surfaces, library };
}

/** Strategies that look at a performance surface. */
const SURFACED = ["gradient", "informative"];
const OWN = "";
const RIG = "ask_tell";
/** Fields that are always there, those under "More", and those of a world that is made for the job. */
const FIRST = ["task", "number", "world", "strategy", "surface", "rounds", "actions", "budget"];
const MORE = ["samples", "residual", "fit", "seed"];
const HIDDEN = ["real.damping", "real.noise", "real.latents.density", "real.latents.friction", "real.latents.restitution"];

/** The form, filled with what another run was asked for; `begun` is told the new job. */
export function begin(of: Choices, like: Asked, begun: (job: Schema<"JobOut">) => void, context: Context): HTMLElement {
  const made = inputs(of, like);
  const fields = labelled(made);
  const at = (name: string): HTMLElement => fields.get(name)!.element;
  const some = (names: readonly string[]): HTMLElement => h("div", { class: "fields" }, ...names.map(at));
  const cost = h("p", { class: "soft", role: "status" });
  const start = h("button", { type: "submit", class: "main" }, "Start");
  const own = h("fieldset", {}, h("legend", {}, "A real world of its own: what it hides"), some(HIDDEN));
  const more = h("details", {}, h("summary", {}, "More"), some(MORE), own);
  more.open = [like.samples, like.fit, like.seed].some((v) => v !== undefined && v !== null);
  const form = h("form", { class: "card stack", novalidate: true, "aria-label": "Start an estimation" }, h("h2", {}, "Start an estimation"), some(FIRST), more, made.parameters, cost, h("div", { class: "row" }, start));
  const told = (): void => {
    put(made.seeks, `Takes ${STRATEGIES[made.strategy.value] ?? ""}.`);
    at("surface").hidden = !SURFACED.includes(made.strategy.value);
    own.hidden = made.real.value !== OWN;
    const bound = Math.min((value(made.rounds) ?? 5) * (value(made.actions) ?? 10), value(made.budget) ?? Infinity);
    put(cost, `Spends at most ${bound} real interactions.`);
  };
  made.task.addEventListener("change", () => offer(of, like, made));
  form.addEventListener("input", told);
  offer(of, like, made);
  told();
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    context.fail(null);
    refused(null, fields);
    const wrong = [...fields.values()].find((f) => f.element.querySelector("input")?.validity.badInput);
    if (wrong) return wrong.refuse("This is no number.");
    start.disabled = true;
    ok(api.POST("/v1/iplw", { body: read(made), signal: context.signal }))
      .then(begun)
      .catch((e: unknown) => {
        more.open ||= named(e, fields);
        if (!refused(e, fields)) context.fail(e);
      })
      .finally(() => (start.disabled = false));
  });
  return form;
}

type Inputs = ReturnType<typeof inputs>;

/** The inputs, as another run had them. */
function inputs(of: Choices, like: Asked) {
  const number = (value: number | null | undefined, placeholder: string, least = 0): HTMLInputElement => h("input", { type: "number", min: least, step: "any", value: value ?? "", placeholder });
  const select = (names: readonly string[], chosen: string | undefined): HTMLSelectElement => h("select", {}, ...names.map((n) => h("option", { value: n, selected: n === chosen }, n)));
  const [family, one] = (like.task ?? of.families[0]?.name ?? "").split(":", 2) as [string, string | undefined];
  const known = typeof like.real === "object" && like.real !== null ? (like.real as Schema<"RealIn">) : {};
  const list = uniqueId("parameters");
  return {
    task: select(of.families.map((f) => f.name), family),
    number: h("input", { type: "number", min: 0, step: 1, value: one ?? "", placeholder: "all for training" }),
    real: h("select", {}),
    strategy: select(Object.keys(STRATEGIES), like.strategy ?? "mixed"),
    /** Says what the strategy looks for. */
    seeks: h("span"),
    surface: h("select", {}),
    rounds: number(like.rounds, "5", 1),
    actions: number(like.actions, "10", 1),
    budget: number(like.budget, "none", 1),
    samples: number(like.samples, "usual", 4),
    residual: select(["trajectory", "shooting"], like.residual ?? "trajectory"),
    fit: h("input", { type: "text", value: (like.fit ?? []).join(", "), placeholder: "none", list, spellcheck: "false", autocomplete: "off" }),
    parameters: h("datalist", { id: list }, ...of.library.flatMap((e) => e.parameters.map((p) => h("option", { value: `${e.name}.${p.name}` })))),
    seed: number(like.seed, "0"),
    damping: number(known.damping, "the family's"),
    noise: number(known.noise, "0"),
    density: number(known.latents?.density, "the family's"),
    friction: number(known.latents?.friction, "the family's"),
    restitution: number(known.latents?.restitution, "the family's"),
  };
}

/** Fields by what the server calls them. */
function labelled(made: Inputs): Map<string, Field> {
  return new Map<string, Field>([
    ["task", field("Family", made.task)],
    ["number", field("Task number", made.number)],
    ["world", field("Real world", made.real, "Its interactions are counted and are what an estimation is sparing with.")],
    ["strategy", field("Strategy", made.strategy, made.seeks)],
    ["surface", field("Performance surface", made.surface, "Says which latents matter for the task.")],
    ["rounds", field("Rounds, at most", made.rounds)],
    ["actions", field("Actions a round", made.actions)],
    ["budget", field("Real interactions, at most", made.budget)],
    ["samples", field("Samples of an iteration", made.samples, "Fewer are faster and less sure.")],
    ["residual", field("Residual", made.residual, "trajectory: from the start to the end; shooting: a stretch at a time, which bears noise and chance.")],
    ["fit", field("Fit along", made.fit, "Parameters of effects, with commas between: linear_drag.c")],
    ["seed", field("Seed", made.seed)],
    ["real.damping", field("Damping, kept a second", made.damping)],
    ["real.noise", field("Noise of observations, m", made.noise)],
    ["real.latents.density", field("Density, kg/m²", made.density)],
    ["real.latents.friction", field("Friction", made.friction)],
    ["real.latents.restitution", field("Restitution", made.restitution)],
  ]);
}

/** Offers the real worlds and surfaces of the family that is chosen. */
function offer(of: Choices, like: Asked, { task, real, surface }: Inputs): void {
  const kept = real.childElementCount ? real.value : (like.world ?? (like.real === RIG ? RIG : OWN));
  const worlds = of.worlds.filter((w) => w.task.split(":")[0] === task.value);
  put(real, h("option", { value: OWN }, "one of its own"), h("option", { value: RIG }, "a rig of yours: ask and tell"), ...worlds.map((w) => h("option", { value: w.id }, `${w.id} (${w.interactions} spent)`)));
  real.value = [...real.options].some((o) => o.value === kept) ? kept : OWN;
  const held = surface.childElementCount ? surface.value : (like.surface ?? "");
  const surfaces = of.surfaces.filter((s) => s.task === task.value);
  put(surface, h("option", { value: "" }, "none named"), ...surfaces.map((s) => h("option", { value: s.id, selected: s.id === held }, s.id)));
}

/** What is asked for. */
function read(made: Inputs): Schema<"Estimation"> {
  const one = made.number.value.trim();
  const latents = given({ density: value(made.density), friction: value(made.friction), restitution: value(made.restitution) });
  const world = given({ damping: value(made.damping), noise: value(made.noise), latents: Object.keys(latents).length ? latents : undefined });
  const fit = made.fit.value.split(",").map((s) => s.trim()).filter(Boolean);
  const surface = SURFACED.includes(made.strategy.value) ? made.surface.value : "";
  const real = made.real.value === RIG ? { real: RIG } : made.real.value !== OWN ? { world: made.real.value } : Object.keys(world).length ? { real: world } : {};
  return {
    task: one === "" ? made.task.value : `${made.task.value}:${one.padStart(3, "0")}`,
    strategy: made.strategy.value,
    residual: made.residual.value,
    ...given({ rounds: value(made.rounds), actions: value(made.actions), samples: value(made.samples), seed: value(made.seed), budget: value(made.budget) }),
    ...(fit.length ? { fit } : {}),
    ...(surface ? { surface } : {}),
    ...real,
  } as Schema<"Estimation">;
}

/** Whether the field that an error names is among those under "More". */
function named(error: unknown, fields: ReadonlyMap<string, Field>): boolean {
  const copy = new Map([...fields].filter(([, f]) => f.element.closest("details")));
  return refused(error, copy);
}

/** A number that was typed. */
function value(input: HTMLInputElement): number | undefined {
  return input.value.trim() === "" ? undefined : Number(input.value);
}

function given<T extends Record<string, unknown>>(of: T): { [K in keyof T]?: NonNullable<T[K]> } {
  return Object.fromEntries(Object.entries(of).filter(([, v]) => v !== undefined)) as { [K in keyof T]?: NonNullable<T[K]> };
}
