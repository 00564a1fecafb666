// The form that starts an estimation; errors of the server's stand at the field that they name.

import { all, api, ok, type Schema } from "../../api/client";
import { fresh, h, put } from "../../dom";
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

/** The form, filled with what another run was asked for; `begun` is told the new job. */
export function begin(of: Choices, like: Asked, begun: (job: Schema<"JobOut">) => void, context: Context): HTMLElement {
  const number = (value: number | null | undefined, placeholder: string, least = 0): HTMLInputElement => h("input", { type: "number", min: least, step: "any", value: value ?? "", placeholder });
  const [family, one] = (like.task ?? of.families[0]?.name ?? "").split(":", 2) as [string, string | undefined];
  const task = h("select", {}, ...of.families.map((f) => h("option", { value: f.name, selected: f.name === family }, f.name)));
  const which = h("input", { type: "number", min: 0, step: 1, value: one ?? "", placeholder: "all for training" });
  const real = h("select", {});
  const strategy = h("select", {}, ...Object.keys(STRATEGIES).map((s) => h("option", { value: s, selected: s === (like.strategy ?? "mixed") }, s)));
  const seeks = h("span");
  const surface = h("select", {});
  const residual = h("select", {}, ...["trajectory", "shooting"].map((r) => h("option", { value: r, selected: r === (like.residual ?? "trajectory") }, r)));
  const rounds = number(like.rounds, "5", 1);
  const actions = number(like.actions, "10", 1);
  const samples = number(like.samples, "as the program has it", 4);
  const seed = number(like.seed, "0");
  const budget = number(like.budget, "none", 1);
  const parameters = fresh("parameters");
  const fit = h("input", { type: "text", value: (like.fit ?? []).join(", "), placeholder: "none", list: parameters, spellcheck: "false", autocomplete: "off" });
  const known = typeof like.real === "object" && like.real !== null ? (like.real as Schema<"RealIn">) : {};
  const damping = number(known.damping, "the family's");
  const noise = number(known.noise, "0");
  const hidden = (name: "density" | "friction" | "restitution"): HTMLInputElement => number(known.latents?.[name], "the family's");
  const [density, friction, restitution] = [hidden("density"), hidden("friction"), hidden("restitution")];
  const fields = new Map<string, Field>([
    ["task", field("Family", task)],
    ["number", field("Task number", which)],
    ["world", field("Real world", real, "Its interactions are counted and are what an estimation is sparing with.")],
    ["strategy", field("Strategy", strategy, seeks)],
    ["surface", field("Performance surface", surface, "Says which latents matter for the task.")],
    ["rounds", field("Rounds, at most", rounds)],
    ["actions", field("Actions a round", actions)],
    ["budget", field("Real interactions, at most", budget)],
    ["samples", field("Samples of an iteration", samples, "Fewer are faster and less sure.")],
    ["residual", field("Residual", residual, "trajectory: from the start to the end; shooting: a stretch at a time, which bears noise and chance.")],
    ["fit", field("Fit along", fit, "Parameters of effects, with commas between: linear_drag.c")],
    ["seed", field("Seed", seed)],
    ["real.damping", field("Damping, kept a second", damping)],
    ["real.noise", field("Noise of observations, m", noise)],
    ["real.latents.density", field("Density, kg/m²", density)],
    ["real.latents.friction", field("Friction", friction)],
    ["real.latents.restitution", field("Restitution", restitution)],
  ]);
  const at = (name: string): HTMLElement => fields.get(name)!.element;
  const cost = h("p", { class: "soft", role: "status" });
  const start = h("button", { type: "submit", class: "main" }, "Start");
  const own = h("fieldset", {}, h("legend", {}, "A real world of its own: what it hides"), h("div", { class: "fields" }, ...["real.damping", "real.noise", "real.latents.density", "real.latents.friction", "real.latents.restitution"].map(at)));
  const more = h("details", {}, h("summary", {}, "More"), h("div", { class: "fields" }, ...["samples", "residual", "fit", "seed"].map(at)), own);
  more.open = [like.samples, like.fit, like.seed].some((v) => v !== undefined && v !== null);
  const list = h("datalist", { id: parameters }, ...of.library.flatMap((e) => e.parameters.map((p) => h("option", { value: `${e.name}.${p.name}` }))));
  const form = h("form", { class: "card stack", novalidate: true, "aria-label": "Start an estimation" }, h("h2", {}, "Start an estimation"), h("div", { class: "fields" }, ...["task", "number", "world", "strategy", "surface", "rounds", "actions", "budget"].map(at)), more, list, cost, h("div", { class: "row" }, start));
  const offered = (): void => {
    const kept = real.childElementCount ? real.value : (like.world ?? (like.real === RIG ? RIG : OWN));
    const worlds = of.worlds.filter((w) => w.task.split(":")[0] === task.value);
    put(real, h("option", { value: OWN }, "one of its own"), h("option", { value: RIG }, "a rig of yours: ask and tell"), ...worlds.map((w) => h("option", { value: w.id }, `${w.id} (${w.interactions} spent)`)));
    real.value = [...real.options].some((o) => o.value === kept) ? kept : OWN;
    const held = surface.childElementCount ? surface.value : (like.surface ?? "");
    put(surface, h("option", { value: "" }, "none named"), ...of.surfaces.filter((s) => s.task === task.value).map((s) => h("option", { value: s.id, selected: s.id === held }, s.id)));
  };
  const told = (): void => {
    put(seeks, `Takes ${STRATEGIES[strategy.value] ?? ""}.`);
    at("surface").hidden = !SURFACED.includes(strategy.value);
    own.hidden = real.value !== OWN;
    const bound = Math.min((value(rounds) ?? 5) * (value(actions) ?? 10), value(budget) ?? Infinity);
    put(cost, `Spends at most ${bound} real interactions.`);
  };
  task.addEventListener("change", offered);
  form.addEventListener("input", told);
  offered();
  told();
  const read = (): Schema<"Estimation"> => {
    const task_ = which.value.trim() === "" ? task.value : `${task.value}:${which.value.trim().padStart(3, "0")}`;
    const latents = given({ density: value(density), friction: value(friction), restitution: value(restitution) });
    const wanted = fit.value.split(",").map((s) => s.trim()).filter(Boolean);
    const world = given({ damping: value(damping), noise: value(noise), latents: Object.keys(latents).length ? latents : undefined });
    return {
      task: task_,
      strategy: strategy.value,
      residual: residual.value,
      ...given({ rounds: value(rounds), actions: value(actions), samples: value(samples), seed: value(seed), budget: value(budget) }),
      ...(wanted.length ? { fit: wanted } : {}),
      ...(!at("surface").hidden && surface.value ? { surface: surface.value } : {}),
      ...(real.value === RIG ? { real: RIG } : real.value !== OWN ? { world: real.value } : Object.keys(world).length ? { real: world } : {}),
    } as Schema<"Estimation">;
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    context.fail(null);
    refused(null, fields);
    start.disabled = true;
    ok(api.POST("/v1/iplw", { body: read(), signal: context.signal }))
      .then(begun)
      .catch((e: unknown) => {
        more.open ||= named(e, fields);
        if (!refused(e, fields)) context.fail(e);
      })
      .finally(() => (start.disabled = false));
  });
  return form;
}

/** Whether the field that an error names is among those under "More". */
function named(error: unknown, fields: ReadonlyMap<string, Field>): boolean {
  const copy = new Map([...fields].filter(([, f]) => f.element.closest("details")));
  return refused(error, copy);
}

/** A number that was typed; what is none goes to the server as it is, which says so. */
function value(input: HTMLInputElement): number | undefined {
  return input.value.trim() === "" ? undefined : Number(input.value);
}

function given<T extends Record<string, unknown>>(of: T): { [K in keyof T]?: NonNullable<T[K]> } {
  return Object.fromEntries(Object.entries(of).filter(([, v]) => v !== undefined)) as { [K in keyof T]?: NonNullable<T[K]> };
}
