// What is asked for of a training: the kind of learner, in what it learns, how much.

import { api, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import type { Context } from "../../view";
import { effects, type Term } from "../play/physics";
import { choice, type Field, given, named, number, refused } from "./fields";

/** What trainings can be made from. */
export interface Given {
  family: Schema<"FamilyOut">;
  worlds: readonly Schema<"WorldOut">[];
  /** Estimations of the family that succeeded. */
  estimations: readonly Schema<"JobOut">[];
  /** Effects that a simulation may have. */
  library: Schema<"EffectOut">[];
}

export type Latents = { density?: number; friction?: number; restitution?: number };

const KINDS: [string, string][] = [
  ["fixed", "In one simulation"],
  ["randomised", "In simulations with latents drawn at random"],
  ["learn", "A policy learns on in a world"],
  ["direct", "In a world alone, from nothing"],
];
const LATENTS: [keyof Latents, string][] = [
  ["density", "density, kg/m²"],
  ["friction", "friction"],
  ["restitution", "restitution"],
];
/** Policies at once that differ by their seed: for the scatter that chance makes. */
const MANY = [1, 3, 5, 10];
/** Looks at AUCCESS on the way that the page asks for. */
const LOOKS = 10;

export interface Form {
  element: HTMLElement;
  /** There are other policies to learn on with; what was typed stays. */
  learners: (policies: readonly Schema<"PolicyOut">[]) => void;
}

/** The form; `started` gets every job that was queued. */
export function form(from: Given, started: (job: Schema<"JobOut">) => void, context: Context): Form {
  const { family, worlds } = from;
  const numbered = Array.from({ length: family.tasks }, (_, i) => `${family.name}:${String(i).padStart(3, "0")}`);
  const whole: [string, string] = [family.name, `all ${family.split.train} training tasks`];
  const kind = choice("Kind of learner", "training", KINDS);
  const task = choice("Tasks", "task", [whole, ...numbered.map((id) => [id, `${id} alone`] as const)]);
  const source = choice("Latents", "source", [
    ["prior", "before anything is known"],
    ...from.estimations.map((job) => [job.id, `as ${job.id} estimated`] as const),
    ["hand", "by hand"],
  ]);
  const latents = LATENTS.map(([name, label]) => number(label, `latents.${name}`, { hint: "empty: the prior's mean" }));
  const policy = choice("Policy", "policy", []);
  const world = choice("World", "world", worlds.map((w) => [w.id, named(w)]));
  const attempts = number("Attempts to learn from", "attempts", { hint: "empty: as many as the updates hold" });
  const batches = number("Updates", "batches", { hint: "empty: the family's own" });
  const size = number("Batch size", "batch_size");
  const looks = number("Validations", "validations", { value: LOOKS });
  const seed = number("Seed", "seed", { value: 0 });
  const many = choice("Policies", "many", MANY.map((n) => [`${n}`, n === 1 ? "one" : `${n}, a seed each`] as const));
  let terms: Term[] = [];
  const fields: Field<HTMLInputElement | HTMLSelectElement>[] = [kind, task, source, ...latents, policy, world, attempts, batches, size, looks, seed, many];
  const button = h("button", { type: "submit", class: "main" }, "Train");
  const physics = h("fieldset", {}, h("legend", {}, "The simulation's latents"), source.element, h("div", { class: "three" }, ...latents.map((l) => l.element)));
  const added = h("details", {}, h("summary", {}, "Effects of the simulation"), effects(from.library, (now) => (terms = now)));
  const spends = h("p", { class: "soft" }, "Attempts in a world are counted there; in a real one they are what is scarce.");
  const show = (): void => {
    const how = kind.input.value;
    const simulated = how === "fixed" || how === "randomised";
    physics.hidden = how !== "fixed";
    added.hidden = !simulated;
    for (const one of [task, looks]) one.element.hidden = !simulated;
    for (const one of [world, attempts]) one.element.hidden = simulated;
    policy.element.hidden = how !== "learn";
    spends.hidden = simulated;
    const none = how === "learn" && !policy.input.options.length;
    button.disabled = none;
    put(button, none ? "No policy to learn on with" : "Train");
  };
  const filled = (): void => {
    const from_ = source.input.value;
    if (from_ === "hand") return;
    const now = estimated(from.estimations.find((job) => job.id === from_));
    LATENTS.forEach(([name], i) => (latents[i]!.input.value = now[name] === undefined ? "" : String(Number(now[name].toPrecision(6)))));
  };
  kind.input.addEventListener("change", show);
  source.input.addEventListener("change", filled);
  for (const one of latents) one.input.addEventListener("input", () => (source.input.value = "hand"));
  const learners = (policies: readonly Schema<"PolicyOut">[]): void => {
    const kept = policy.input.value;
    const own = policies.filter((p) => p.task === family.name);
    put(policy.input, ...own.map((p) => h("option", { value: p.id, selected: p.id === kept }, `${p.id}, ${p.training.replaceAll("_", " ")}`)));
    show();
  };
  show();
  const ask = (nth: number): Promise<Schema<"JobOut">> => {
    const how = kind.input.value;
    const budget = { ...some("batches", given(batches)), ...some("batch_size", given(size)), ...some("seed", nth === 0 ? given(seed) : (given(seed) ?? 0) + nth) };
    if (how === "learn" || how === "direct") {
      const body = { world: world.input.value, ...some("attempts", given(attempts)), ...budget };
      const id = how === "direct" ? "untrained" : policy.input.value;
      return ok(api.POST("/v1/policies/{id}/learn", { params: { path: { id } }, body, signal: context.signal }));
    }
    const values = Object.fromEntries(LATENTS.flatMap(([name], i) => (given(latents[i]!) === undefined ? [] : [[name, given(latents[i]!)]])));
    const training = how as Schema<"TrainingIn">;
    const physics_ = how === "fixed" ? { latents: values } : {};
    const body = { task: task.input.value, training, ...physics_, ...(terms.length ? { effects: terms } : {}), ...budget, ...some("validations", given(looks)) };
    return ok(api.POST("/v1/policies", { body, signal: context.signal }));
  };
  const element = h("form", { class: "stack train-form", novalidate: true });
  put(
    element,
    h("div", { class: "two" }, kind.element, task.element, policy.element, world.element, attempts.element),
    physics,
    added,
    spends,
    h("div", { class: "three" }, batches.element, size.element, looks.element, seed.element, many.element),
    h("div", { class: "row" }, button),
  );
  element.addEventListener("submit", (event) => {
    event.preventDefault();
    for (const one of fields) one.refuse(null);
    context.fail(null);
    button.disabled = true;
    const all = async (): Promise<void> => {
      for (let nth = 0; nth < Number(many.input.value); nth++) started(await ask(nth));
    };
    all()
      .catch((e: unknown) => refused(fields, e) || context.fail(e))
      .finally(show);
  });
  return { element, learners };
}

/** The latents of an estimation; none of no estimation. */
export function estimated(job: Schema<"JobOut"> | undefined): Latents {
  const found = (job?.result as { latents?: { name: string; value: number }[] } | undefined)?.latents ?? [];
  const known = found.filter((l) => LATENTS.some(([name]) => name === l.name));
  return Object.fromEntries(known.map((l) => [l.name, l.value]));
}

/** A field of a request that is left out where nothing was given. */
function some<K extends string>(name: K, value: number | undefined): { [key in K]?: number } {
  return value === undefined ? {} : ({ [name]: value } as { [key in K]?: number });
}
