// The training form: kind of training, physics, budget.

import { api, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import type { Context } from "../../view";
import { effects, type EffectTerm } from "../play/physics";
import { choice, type RequestField, numberOf, worldLabel, number, showFieldError } from "./requestFields";

/** Options of the form. */
export interface TrainingInputs {
  family: Schema<"FamilyOut">;
  worlds: readonly Schema<"WorldOut">[];
  /** Successful estimations of the family. */
  estimations: readonly Schema<"JobOut">[];
  /** Effects available in a simulation. */
  library: Schema<"EffectOut">[];
}

export type Latents = { density?: number; friction?: number; restitution?: number };

const KINDS: [string, string][] = [
  ["fixed", "In one simulation"],
  ["randomised", "In randomised simulations"],
  ["learn", "Train a policy further in a world"],
  ["direct", "In a world, from scratch"],
];
const LATENTS: [keyof Latents, string][] = [
  ["density", "density, kg/m²"],
  ["friction", "friction"],
  ["restitution", "restitution"],
];
/** Numbers of policies that differ only by their seed. */
const SEED_COUNTS = [1, 3, 5, 10];
/** Default number of validations. */
const DEFAULT_VALIDATIONS = 10;

export interface TrainingForm {
  element: HTMLElement;
  /** Updates the list of policies that can be trained further; other inputs stay. */
  learners: (policies: readonly Schema<"PolicyOut">[]) => void;
}

/** The form; `onStarted` gets every queued job. */
export function form(from: TrainingInputs, onStarted: (job: Schema<"JobOut">) => void, context: Context): TrainingForm {
  const { family, worlds } = from;
  const taskIds = Array.from({ length: family.tasks }, (_, i) => `${family.name}:${String(i).padStart(3, "0")}`);
  const allTasks: [string, string] = [family.name, `all ${family.split.train} training tasks`];
  const kind = choice("Kind of training", "training", KINDS);
  const task = choice("Tasks", "task", [allTasks, ...taskIds.map((id) => [id, `${id} alone`] as const)]);
  const source = choice("Latents", "source", [
    ["prior", "prior means"],
    ...from.estimations.map((job) => [job.id, `as ${job.id} estimated`] as const),
    ["hand", "by hand"],
  ]);
  const latents = LATENTS.map(([name, label]) => number(label, `latents.${name}`, { hint: "empty: the prior's mean" }));
  const policy = choice("Policy", "policy", []);
  const world = choice("World", "world", worlds.map((w) => [w.id, worldLabel(w)]));
  const attempts = number("Attempts to learn from", "attempts", { hint: "empty: as many as the updates use" });
  const batches = number("Updates", "batches", { hint: "empty: the family's default" });
  const size = number("Batch size", "batch_size");
  const validations = number("Validations", "validations", { value: DEFAULT_VALIDATIONS });
  const seed = number("Seed", "seed", { value: 0 });
  const policyCount = choice("Policies", "many", SEED_COUNTS.map((n) => [`${n}`, n === 1 ? "one" : `${n}, one seed each`] as const));
  let terms: EffectTerm[] = [];
  const fields: RequestField<HTMLInputElement | HTMLSelectElement>[] = [kind, task, source, ...latents, policy, world, attempts, batches, size, validations, seed, policyCount];
  const button = h("button", { type: "submit", class: "main" }, "Train");
  const physics = h("fieldset", {}, h("legend", {}, "The simulation's latents"), source.element, h("div", { class: "three" }, ...latents.map((l) => l.element)));
  const added = h("details", {}, h("summary", {}, "Effects of the simulation"), effects(from.library, (now) => (terms = now)));
  const spends = h("p", { class: "soft" }, "Attempts in a world are counted.");
  const show = (): void => {
    const learner = kind.input.value;
    const simulated = learner === "fixed" || learner === "randomised";
    physics.hidden = learner !== "fixed";
    added.hidden = !simulated;
    for (const one of [task, validations]) one.element.hidden = !simulated;
    for (const one of [world, attempts]) one.element.hidden = simulated;
    policy.element.hidden = learner !== "learn";
    spends.hidden = simulated;
    const none = learner === "learn" && !policy.input.options.length;
    button.disabled = none;
    put(button, none ? "No policy to train" : "Train");
  };
  const fillLatents = (): void => {
    const sourceId = source.input.value;
    if (sourceId === "hand") return;
    const now = estimatedLatents(from.estimations.find((job) => job.id === sourceId));
    LATENTS.forEach(([name], i) => (latents[i]!.input.value = now[name] === undefined ? "" : String(Number(now[name].toPrecision(6)))));
  };
  kind.input.addEventListener("change", show);
  source.input.addEventListener("change", fillLatents);
  for (const one of latents) one.input.addEventListener("input", () => (source.input.value = "hand"));
  const learners = (policies: readonly Schema<"PolicyOut">[]): void => {
    const selected = policy.input.value;
    const ofFamily = policies.filter((p) => p.task === family.name);
    put(policy.input, ...ofFamily.map((p) => h("option", { value: p.id, selected: p.id === selected }, `${p.id}, ${p.training.replaceAll("_", " ")}`)));
    show();
  };
  show();
  const ask = (nth: number): Promise<Schema<"JobOut">> => {
    const learner = kind.input.value;
    const budget = { ...optional("batches", numberOf(batches)), ...optional("batch_size", numberOf(size)), ...optional("seed", nth === 0 ? numberOf(seed) : (numberOf(seed) ?? 0) + nth) };
    if (learner === "learn" || learner === "direct") {
      const body = { world: world.input.value, ...optional("attempts", numberOf(attempts)), ...budget };
      const id = learner === "direct" ? "untrained" : policy.input.value;
      return ok(api.POST("/v1/policies/{id}/learn", { params: { path: { id } }, body, signal: context.signal }));
    }
    const values = Object.fromEntries(LATENTS.flatMap(([name], i) => (numberOf(latents[i]!) === undefined ? [] : [[name, numberOf(latents[i]!)]])));
    const training = learner as Schema<"TrainingIn">;
    const latentsBody = learner === "fixed" ? { latents: values } : {};
    const body = { task: task.input.value, training, ...latentsBody, ...(terms.length ? { effects: terms } : {}), ...budget, ...optional("validations", numberOf(validations)) };
    return ok(api.POST("/v1/policies", { body, signal: context.signal }));
  };
  const element = h("form", { class: "stack train-form", novalidate: true });
  put(
    element,
    h("div", { class: "two" }, kind.element, task.element, policy.element, world.element, attempts.element),
    physics,
    added,
    spends,
    h("div", { class: "three" }, batches.element, size.element, validations.element, seed.element, policyCount.element),
    h("div", { class: "row" }, button),
  );
  element.addEventListener("submit", (event) => {
    event.preventDefault();
    for (const one of fields) one.showError(null);
    context.fail(null);
    button.disabled = true;
    const all = async (): Promise<void> => {
      for (let nth = 0; nth < Number(policyCount.input.value); nth++) onStarted(await ask(nth));
    };
    all()
      .catch((e: unknown) => showFieldError(fields, e) || context.fail(e))
      .finally(show);
  });
  return { element, learners };
}

/** The latents of an estimation, if any. */
export function estimatedLatents(job: Schema<"JobOut"> | undefined): Latents {
  const estimates = (job?.result as { latents?: { name: string; value: number }[] } | undefined)?.latents ?? [];
  const relevant = estimates.filter((l) => LATENTS.some(([name]) => name === l.name));
  return Object.fromEntries(relevant.map((l) => [l.name, l.value]));
}

/** A request field that is omitted if undefined. */
function optional<K extends string>(name: K, value: number | undefined): { [key in K]?: number } {
  return value === undefined ? {} : ({ [name]: value } as { [key in K]?: number });
}
