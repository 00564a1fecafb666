// Design: the experiments that are worth doing next. `#/design` starts a design, `#/design/job-3` is a design; `?posterior=job-2`
// names the posterior.

import { api, ok } from "../api/client";
import { effectLibrary } from "../api/effects";
import { h } from "../dom";
import { choiceField, numberFields, numbersOf } from "../parts/requestField";
import { type Context, link, type View } from "../view";
import { effectSets } from "./analysis/effectSets";
import type { AnalysisKind, Job } from "./analysis/kind";
import { jobPage, type ResultPage } from "./analysis/jobPage";
import { sampleSource } from "./analysis/sampleSource";
import { type StartedJob, startPage } from "./analysis/startPage";
import { taskField } from "./analysis/taskField";
import { tryPanel } from "./analysis/tryPanel";
import { worldsOf } from "./analysis/worlds";
import { experimentCards } from "./design/cards";
import { type Design, headline, nats } from "./design/result";
import "./analysis.css";

const KIND: AnalysisKind = { view: "design", kind: "design", title: "Design", subject: "The design" };

export const design: View = {
  id: "design",
  title: "Design",
  about: "Choose the experiments that are worth doing next.",
  open: (place, context) => (context.rest[0] ? jobPage(place, KIND, context.rest[0], (job) => result(job, context), context) : start(place, context)),
};

const PURPOSE =
  "A design finds the experiment that is worth doing next. It compares candidate actions by how much their outcome is expected to narrow what is still unknown, so that few trials are enough.";
const EXAMPLE_TASK = "bowling:003";
const QUESTIONS = [
  ["latents", "how large latents and effects are"],
  ["effects", "which effects the world has"],
  ["success", "whether plans solve the test tasks"],
] as const;

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { query, signal } = context;
  const [{ families }, source, library] = await Promise.all([
    ok(api.GET("/v1/tasks", { signal })),
    sampleSource(query, false, null, signal),
    effectLibrary(signal),
  ]);
  const task = taskField(families, query.get("task") ?? EXAMPLE_TASK, "The task to experiment with, or a family: then its training tasks are compared.", context);
  const number = numberFields(query);
  const question = choiceField("Question", "question", QUESTIONS, query.get("question"), { help: "What the experiments should answer." });
  const batch = number("Experiments", "batch", "1", "How many to choose together, up to 20. They complement one another.");
  const seed = number("Seed", "seed", "0", "The same seed gives the same design.");
  const candidates = number("Candidate actions", "candidates", "400", "More candidates find better experiments and take longer.");
  const worlds = number("Worlds", "worlds", "128", "In how many worlds the best candidates are simulated, 8 to 256.");
  const shortlist = number("Shortlist", "shortlist", "24", "How many of the best candidates are evaluated precisely.");
  const noise = number("Measurement noise, m", "noise", "0.005", "Standard deviation of a measured position. More noise favours larger motions.");
  const perturb = number("Imprecision", "perturb", "0.002", "How inaccurately an action is carried out, as a share of each component's range.");
  const numbers = [batch, seed, candidates, worlds, shortlist, noise, perturb];
  const sets = effectSets(library, query.get("sets"), "sets", "With the prior: sets of effects that the world may have, each equally likely.");
  const startJob = async (): Promise<StartedJob> => {
    const samples = await source.request();
    const prior = samples.posterior || !sets.value().length ? {} : { sets: [[], ...sets.value()] };
    const body = { task: task.value(), question: question.input.value, ...numbersOf(numbers), ...prior, ...samples };
    return ok(api.POST("/v1/designs", { body, signal }));
  };
  const example = {
    label: `Try with ${EXAMPLE_TASK}`,
    about: "Two experiments out of 100 candidates, under the prior; takes a few seconds.",
    start: () => ok(api.POST("/v1/designs", { body: { task: EXAMPLE_TASK, batch: 2, candidates: 100, worlds: 32, shortlist: 8, seed: 1 }, signal })),
  };
  const page = { kind: KIND, purpose: PURPOSE, example, main: [task.element, source.element, question.element, batch.element, seed.element], more: [...[candidates, worlds, shortlist, noise, perturb].map((f) => f.element), sets.element] };
  await startPage(place, { ...page, fields: [task.field, source.field, question, ...numbers], submit: "Design", start: startJob, query: source.query }, context);
}

async function result(job: Job, context: Context): Promise<ResultPage> {
  const { query, signal } = context;
  const design = job.result as unknown as Design;
  const { task, posterior } = job.config as unknown as { task: string; posterior?: { source: string } };
  const worlds = await worldsOf(query, task.split(":")[0]!, posterior?.source ?? "prior", signal);
  const panel = tryPanel(worlds, context);
  panel.element.hidden = true;
  const cards = await experimentCards(design.experiments, (experiment, name) => {
    panel.element.hidden = false;
    panel.show(experiment.task, experiment.action, name);
  }, context);
  const { question, batch, candidates, seed, noise } = design.config;
  const source = Object.fromEntries(query);
  const information = `${design.together.information.toFixed(1)} ± ${nats(design.together.standard_error)}`;
  return {
    headline: headline(design),
    notes: [
      h("p", {}, `Expected information: ${information}. One nat is a factor of 2.7 in precision.`),
      h("p", { class: "soft" }, `${design.candidates} candidate actions compared in ${design.config.worlds.at(-1)} worlds; ${design.rollouts} rollouts. Numbers are expectations before the measurement.`),
    ],
    steps: [h("a", { class: "button", href: link("calibrate") }, "Measure and calibrate"), h("a", { class: "button", href: link("plan", [], { ...(task.includes(":") ? { task } : {}), ...source }) }, "Plan the task")],
    parts: [cards, panel.element],
    substitutes: [],
    request: { task, question, batch: String(batch), candidates: String(candidates), seed: String(seed), noise: String(noise), ...source },
  };
}
