// Comparison of policies with each other and with random actions, in one world: share solved over attempts, with intervals.

import { api, ok, type Schema } from "../../api/client";
import { h, put, set } from "../../dom";
import { key } from "../../parts/curvePlot";
import { type Context, link } from "../../view";
import { evaluations } from "./evaluations";
import { choice, type RequestField, numberOf, worldLabel, number, showFieldError } from "./requestFields";
import { figures } from "./figures";
import { requestOf, ATTEMPTS, auccess, difference, CHANCE, curve, type Evaluation, type Interval, interval, trainingKey, type EvaluationSetting } from "./scores";

type Job = Schema<"JobOut">;

/** Input of a comparison. */
export interface ComparisonInput {
  family: string;
  policies: Schema<"PolicyOut">[];
  worlds: Schema<"WorldOut">[];
  /** Evaluation and learning jobs, ended or not. */
  evaluations: Job[];
  learnt: Job[];
  /** Initial selection: an evaluation or a policy. */
  job: Job | null;
  policy: string | null;
  /** The user's choice before a rebuild. */
  kept: ComparisonChoice | null;
}

/** The user's choice in a comparison. */
export interface ComparisonChoice {
  setting: EvaluationSetting;
  ticked: string[];
}

export interface Comparison {
  element: HTMLElement;
  kept: () => ComparisonChoice;
}

/** The comparison. */
export function compare(of: ComparisonInput, context: Context): Comparison {
  const start = of.kept?.setting ?? (of.job ? { ...requestOf(of.job), seed: of.job.seed } : null);
  const { fields, setting } = controls(of.worlds, start);
  const rows = [CHANCE, ...of.policies.filter((p) => p.task === of.family).map((p) => p.id)].map((id, look) => row(id, look, of.policies.find((p) => p.id === id) ?? null));
  const figuresView = figures();
  const button = h("button", { type: "button", class: "main" }, "Evaluate selected");
  const spent = h("p", { class: "soft", role: "status" });
  const runs = evaluations(of.evaluations, (over) => (show(), over && refresh().catch(context.fail)), context);
  const evaluationOf = (id: string): Evaluation | undefined => runs.evaluationOf(id, setting());
  const world = (): Schema<"WorldOut"> | undefined => of.worlds.find((w) => w.id === setting().world);
  const show = (): void => {
    const chance = evaluationOf(CHANCE);
    for (const one of rows) fillRow(one, evaluationOf(one.id), chance, runs.running(one.id));
    const ticked = rows.filter((one) => one.tick.checked);
    const evaluatedPolicies = ticked.flatMap((one) => {
      const e = evaluationOf(one.id);
      return e ? [{ id: one.id, look: one.look, training: one.training, schooling: trainingKey(of.policies, one.id), evaluation: e, curve: curve(e.solvedAt, e.attempts), auccess: auccess(e.solvedAt) }] : [];
    });
    figuresView.draw(evaluatedPolicies, chance, of.learnt, world()?.kind === "real");
    const lacking = ticked.filter((one) => !evaluationOf(one.id) && !runs.running(one.id)).length;
    button.disabled = lacking === 0;
    put(spent, ...interactionsText(world(), lacking, setting().attempts));
  };
  const refresh = async (): Promise<void> => {
    const id = setting().world;
    if (!id) return;
    const now = await ok(api.GET("/v1/worlds/{id}", { params: { path: { id } }, signal: context.signal }));
    of.worlds = of.worlds.map((w) => (w.id === now.id ? now : w));
    show();
  };
  button.addEventListener("click", () => {
    button.disabled = true;
    context.fail(null);
    for (const one of fields) one.showError(null);
    runs
      .ask(rows.filter((one) => one.tick.checked).map((one) => one.id), setting())
      .catch((e: unknown) => showFieldError(fields, e) || context.fail(e))
      .finally(show);
  });
  for (const one of fields) one.input.addEventListener("change", () => (show(), refresh().catch(context.fail)));
  for (const one of rows) {
    const first = one.id === CHANCE || (of.job !== null && one.id === requestOf(of.job).policy) || Boolean(evaluationOf(one.id) ?? runs.running(one.id));
    one.tick.checked = one.id === of.policy || (of.kept ? of.kept.ticked.includes(one.id) : first);
    one.tick.addEventListener("change", show);
  }
  runs.start();
  show();
  refresh().catch(context.fail);
  const tableColumn = h("div", {}, h("div", { class: "wide" }, table(of.family, rows)), h("div", { class: "row" }, button, spent));
  const element = h("div", { class: "stack" }, h("div", { class: "four" }, ...fields.map((one) => one.element)), h("div", { class: "train-sides" }, tableColumn, figuresView.element));
  return { element, kept: () => ({ setting: setting(), ticked: rows.filter((one) => one.tick.checked).map((one) => one.id) }) };
}

/** Fields for world, split, attempts and seed. */
function controls(worlds: readonly Schema<"WorldOut">[], start: Partial<EvaluationSetting> | null): { fields: RequestField<HTMLInputElement | HTMLSelectElement>[]; setting: () => EvaluationSetting } {
  const world = choice("World", "world", worlds.map((w) => [w.id, worldLabel(w)]));
  const split = choice("Tasks", "split", [["test", "test"], ["validation", "validation"], ["train", "training"]]);
  const attempts = number("Attempts per task", "attempts", { value: start?.attempts ?? ATTEMPTS });
  const seed = number("Seed of candidates", "seed", { value: start?.seed ?? 0 });
  if (start?.world && worlds.some((w) => w.id === start.world)) world.input.value = start.world;
  if (start?.split) split.input.value = start.split;
  const setting = (): EvaluationSetting => ({ world: world.input.value, split: split.input.value, attempts: numberOf(attempts) ?? ATTEMPTS, seed: numberOf(seed) ?? 0 });
  return { fields: [world, split, attempts, seed], setting };
}

function table(family: string, rows: readonly Row[]): HTMLElement {
  const heads = ["Show", "Policy", "AUCCESS", "Over random", "At 1", "Within 10", "Spent"].map((t) => h("th", { scope: "col" }, t));
  const caption = h("caption", { class: "unseen" }, `Policies of ${family}, evaluated in the selected world`);
  return h("table", { class: "policies" }, caption, h("thead", {}, h("tr", {}, ...heads)), h("tbody", {}, ...rows.map((one) => one.element)));
}

/** Interactions spent in a world, and the cost of an evaluation. */
function interactionsText(world: Schema<"WorldOut"> | undefined, lacking: number, attempts: number): (HTMLElement | string)[] {
  if (!world) return [];
  const what = world.kind === "real" ? "Real interactions" : "Interactions";
  return [`${what} spent in ${world.id}: `, h("strong", {}, world.interactions), lacking ? `. An evaluation spends up to ${attempts} per task.` : "."];
}

interface Row {
  id: string;
  look: number;
  training: string;
  element: HTMLTableRowElement;
  tick: HTMLInputElement;
  cells: HTMLElement[];
}

function row(id: string, look: number, policy: Schema<"PolicyOut"> | null): Row {
  const tick = h("input", { type: "checkbox", "aria-label": `Show ${id}` });
  const cells = Array.from({ length: 5 }, () => h("td"));
  const named = policy ? h("a", { href: link("train", [id]) }, id) : h("strong", {}, id);
  const about = policy ? `${policy.training.replaceAll("_", " ")}; ${policy.about.replace(/^.*hidden units, /, "")}` : "random order: the baseline";
  const name = h("th", { scope: "row" }, h("span", { class: "name" }, key(look), named), " ", h("span", { class: "soft" }, about));
  const element = h("tr", { "data-policy": id }, h("td", {}, tick), name, ...cells);
  return { id, look, training: policy?.training ?? "none", element, tick, cells };
}

/** Fills a row with the evaluation in the selected setting, or its progress. */
function fillRow(row: Row, e: Evaluation | undefined, chance: Evaluation | undefined, job: Job | undefined): void {
  if (!e) {
    const { done, total } = job?.progress ?? { done: 0, total: 0 };
    const bar = job ? h("progress", { max: Math.max(1, total), value: done, "aria-label": `Progress of ${job.id}` }) : h("span", { class: "soft" }, "not evaluated");
    row.cells.forEach((cell, i) => put(cell, i === 0 ? bar : null));
    return;
  }
  const solved = curve(e.solvedAt, e.attempts);
  const advantage = chance && e !== chance ? difference(e.solvedAt, chance.solvedAt) : null;
  const words = [intervalText(auccess(e.solvedAt)), advantage ? intervalText(advantage, true) : "", percent(solved[0]), percent(solved[9]), e.interactions];
  const labels = ["AUCCESS", "over random", "solved at 1", "within 10", "spent"];
  row.cells.forEach((cell, i) => put(set(cell, { "data-label": labels[i]! }), words[i] === "" ? null : words[i]));
}

/** A value with its interval below. */
function intervalText(of: Interval, signed = false): HTMLElement {
  const [value, ...rest] = interval(of, signed).split(" ");
  return h("span", { class: "within" }, value, h("span", { class: "soft" }, ` ${rest.join(" ")}`));
}

function percent(share: Interval | undefined): string {
  return share ? `${Math.round(100 * share.value)} %` : "";
}
