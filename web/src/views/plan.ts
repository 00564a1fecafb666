// Plan: the actions that most probably solve a task. `#/plan` starts a plan, `#/plan/scene` with the effects of a scene of another
// view, `#/plan/job-3` is a plan; `?posterior=job-2` names the posterior.

import { api, ok } from "../api/client";
import { h } from "../dom";
import { numberFields, numbersOf } from "../parts/requestField";
import { type Context, link, type View } from "../view";
import type { AnalysisKind, Job } from "./analysis/kind";
import { jobPage, type ResultPage } from "./analysis/jobPage";
import { sampleSource } from "./analysis/sampleSource";
import { type StartedJob, startPage } from "./analysis/startPage";
import { taskField } from "./analysis/taskField";
import { tryPanel } from "./analysis/tryPanel";
import { worldsOf } from "./analysis/worlds";
import { headline, isUncertain, methodText, type Plan } from "./plan/result";
import { sceneWorld } from "./plan/sceneWorld";
import { topActions } from "./plan/topActions";
import { loadTask } from "./play/taskPicker";
import "./analysis.css";

const KIND: AnalysisKind = { view: "plan", kind: "plan", title: "Plan", subject: "The plan" };

export const plan: View = {
  id: "plan",
  title: "Plan",
  about: "Find the actions that most probably solve a task.",
  open: (place, context) => {
    const [first] = context.rest;
    return first && first !== "scene" ? jobPage(place, KIND, first, (job) => result(job, context), context) : start(place, context);
  },
};

const PURPOSE =
  "A plan finds the action to try first. It simulates thousands of candidate actions in many worlds that your data allow, and ranks them by how often they solve the task.";
const EXAMPLE_TASK = "bowling:003";

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { query, signal } = context;
  const { families } = await ok(api.GET("/v1/tasks", { signal }));
  const world = sceneWorld(families, context);
  const source = await sampleSource(query, true, world?.physics ?? null, signal);
  const task = taskField(families, query.get("task") ?? (world?.family ? `${world.family}:003` : EXAMPLE_TASK), "The task to solve. Choose it by its picture, or enter its id.", context);
  const number = numberFields(query);
  const actions = number("Candidate actions", "actions", "10000", "More candidates find better actions and take longer, in proportion.");
  const draws = number("Worlds per action", "draws", "64", "In how many worlds the promising actions are simulated. More give more precise probabilities.");
  const seed = number("Seed", "seed", "0", "The same seed gives the same plan.");
  const exact = number("Best actions", "exact", "10", "How many of the best are identified exactly and simulated again.");
  const perturb = number("Imprecision", "perturb", "0.002", "How inaccurately an action is carried out, as a share of each component's range. 0: exactly.");
  const seconds = number("Time limit, s", "seconds", "none", "The plan is the best known by then; it may differ between runs.");
  const rollouts = number("Rollout limit", "rollouts", "none", "A limit that gives the same plan on every machine.");
  const numbers = [actions, draws, seed, exact, perturb, seconds, rollouts];
  const startJob = async (): Promise<StartedJob> => {
    const body = { task: task.value(), ...numbersOf(numbers), ...(await source.request()) };
    return ok(api.POST("/v1/plans", { body, signal }));
  };
  const example = {
    label: `Try with ${EXAMPLE_TASK}`,
    about: "2,000 actions under the prior; takes a few seconds.",
    start: () => ok(api.POST("/v1/plans", { body: { task: EXAMPLE_TASK, actions: 2000, draws: 32, seed: 1 }, signal })),
  };
  const page = { kind: KIND, purpose: PURPOSE, example, notice: world?.notice ?? null, main: [task.element, source.element, actions.element, seed.element], more: [draws, exact, perturb, seconds, rollouts].map((f) => f.element) };
  await startPage(place, { ...page, fields: [task.field, source.field, ...numbers], submit: "Plan", start: startJob, query: source.query }, context);
}

async function result(job: Job, context: Context): Promise<ResultPage> {
  const { signal, query } = context;
  const plan = job.result as unknown as Plan;
  const family = plan.task.split(":")[0]!;
  const [worlds, { scene }] = await Promise.all([worldsOf(query, family, plan.posterior.source, signal), loadTask(plan.task, signal)]);
  const panel = tryPanel(worlds, context);
  const list = topActions(plan, scene, (action, name) => panel.show(plan.task, action, name));
  // The first action is displayed at once.
  list.querySelector("button")?.click();
  const source = Object.fromEntries(query);
  const { actions, draws, seed, exact, perturb } = plan.config;
  const uncertain = isUncertain(plan);
  const design = link("design", [], { task: plan.task, ...(query.has("posterior") ? { posterior: query.get("posterior")! } : {}) });
  return {
    headline: headline(plan, plan.posterior.source === "prior" && query.has("world")),
    notes: [
      h("p", { class: "soft" }, methodText(plan)),
      uncertain ? h("p", {}, "No action is safe yet: the worlds still differ too much. An experiment that narrows them may help more than an attempt.") : null,
    ],
    steps: [h("a", { class: uncertain ? "button main" : "button", href: design }, "Design the next experiment"), uncertain && !query.has("posterior") ? h("a", { class: "button", href: link("posterior") }, "Infer a posterior from trials") : null],
    parts: [h("div", { class: "columns" }, list, panel.element)],
    substitutes: [],
    request: { task: plan.task, actions: String(actions), draws: String(draws), seed: String(seed), exact: String(exact), perturb: String(perturb), ...source },
  };
}
