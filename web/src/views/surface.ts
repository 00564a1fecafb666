// Surface: which latents matter for a family of tasks. `#/surface` starts one, `#/surface/job-3` is a surface.

import { api, ok } from "../api/client";
import { h } from "../dom";
import { choiceField, numberFields, numbersOf } from "../parts/requestField";
import { type Context, link, type View } from "../view";
import { capital, enumeration } from "./analysis/actionText";
import type { AnalysisKind, Job } from "./analysis/kind";
import { jobPage, type ResultPage } from "./analysis/jobPage";
import { type StartedJob, startPage } from "./analysis/startPage";
import { bySensitivity, headline, pointsText, stakeText, type SurfaceResult } from "./surface/result";
import { sensitivityBars } from "./surface/sensitivityBars";
import "./analysis.css";

const KIND: AnalysisKind = { view: "surface", kind: "surface", title: "Surface", subject: "The surface" };

export const surface: View = {
  id: "surface",
  title: "Surface",
  about: "Compare how much each latent matters for solving tasks.",
  open: (place, context) => (context.rest[0] ? jobPage(place, KIND, context.rest[0], (job) => result(job), context) : start(place, context)),
};

const PURPOSE =
  "A performance surface shows how much each latent (density, friction, restitution) matters for solving the tasks of a family. So it shows what is worth measuring: a latent without influence needs no precise estimate.";
const FACTORS = [
  ["friction,restitution", "friction and restitution"],
  ["density,friction", "density and friction"],
  ["density,restitution", "density and restitution"],
  ["density,friction,restitution", "all three"],
] as const;
const ROUTES = [
  ["ideal", "actions that solve the simulation (no learning)"],
  ["dqn", "a policy trained at every point (slow)"],
] as const;

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { query, signal } = context;
  const { families } = await ok(api.GET("/v1/tasks", { signal }));
  const task = choiceField("Tasks", "task", families.map((f) => [f.name, `${f.name}: ${f.about}`] as const), query.get("task"), { help: "The family of tasks to solve." });
  const factors = choiceField("Latents to vary", "factors", FACTORS, query.get("factors"), { help: "The latents whose influence is compared; each is varied over its whole range." });
  const number = numberFields(query);
  const points = number("Points", "points", "40", "Combinations of latents to try. Fewer than 20 give a rough picture only.");
  const seed = number("Seed", "seed", "0", "The same seed gives the same surface.");
  const actions = number("Actions per task", "actions", "the family's", "How many actions are simulated for each task, at each point. Fewer are faster.");
  const route = choiceField("Score of a point", "route", ROUTES, query.get("route"), { help: "What is scored at each point." });
  const numbers = [points, seed, actions];
  const startJob = (): Promise<StartedJob> => {
    const body = { task: task.input.value, factors: factors.input.value.split(","), route: route.input.value, ...numbersOf(numbers) };
    return ok(api.POST("/v1/surfaces", { body, signal }));
  };
  const example = {
    label: "Try with bowling",
    about: "Six points with 300 actions; takes a few seconds.",
    start: () => ok(api.POST("/v1/surfaces", { body: { task: "bowling", points: 6, actions: 300, seed: 1 }, signal })),
  };
  const page = { kind: KIND, purpose: PURPOSE, example, main: [task, factors, points, seed].map((f) => f.element), more: [actions.element, route.element] };
  await startPage(place, { ...page, fields: [task, factors, ...numbers, route], submit: "Compute the surface", start: startJob }, context);
}

async function result(job: Job): Promise<ResultPage> {
  const { surface, sensitivities, config } = job.result as unknown as SurfaceResult;
  const { task, actions } = job.config as unknown as { task: string; actions?: number };
  const factors = sensitivities.map((s) => s.factor);
  return {
    headline: headline(task, sensitivities),
    notes: [
      ...bySensitivity(sensitivities).map((s) => h("p", {}, stakeText(s))),
      h("p", { class: "soft" }, `${capital(enumeration(factors))} were varied over their ranges, at ${pointsText(config.points, factors.length)} The score is AUCCESS, from 0 to 1: how soon the tasks are solved. Stored as ${surface}.`),
    ],
    steps: [h("a", { class: "button main", href: link("calibrate", [], { task, strategy: "informative", surface }) }, "Use it for an estimation")],
    parts: [],
    substitutes: [sensitivityBars(sensitivities)],
    request: { task, factors: factors.join(","), points: String(config.points), seed: String(config.seed), ...(actions === undefined ? {} : { actions: String(actions) }), route: config.route },
  };
}
