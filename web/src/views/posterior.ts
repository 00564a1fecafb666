// Posterior: the parameter values that measured trials allow. `#/posterior` starts one, `?job=job-2` of the trials of an estimation
// or a diagnosis, `#/posterior/job-3` is a posterior.

import { api, ok } from "../api/client";
import { effectLibrary } from "../api/effects";
import { h, put } from "../dom";
import { codeText } from "../parts/codeText";
import { checkField, choiceField, numberFields, numbersOf } from "../parts/requestField";
import { type Context, link, type View } from "../view";
import { effectSets } from "./analysis/effectSets";
import type { AnalysisKind, Job } from "./analysis/kind";
import { jobPage, type ResultPage } from "./analysis/jobPage";
import { samplesOf } from "./analysis/physics";
import { type StartedJob, startPage } from "./analysis/startPage";
import { startExample } from "./posterior/example";
import { parameterTable } from "./posterior/parameterTable";
import { convergenceText, headline, lacksForce, type Posterior, warningText } from "./posterior/result";
import { trialSource } from "./posterior/trialSource";
import "./analysis.css";

const KIND: AnalysisKind = { view: "posterior", kind: "posterior", title: "Posterior", subject: "The posterior" };

export const posterior: View = {
  id: "posterior",
  title: "Posterior",
  about: "Infer which parameter values your trials allow.",
  open: (place, context) => (context.rest[0] ? jobPage(place, KIND, context.rest[0], (job) => result(job, context), context) : start(place, context)),
};

const PURPOSE =
  "A posterior is the set of parameter values that your measured trials allow, as samples. It shows which parameters the trials identify and how precisely; plans and designs can use it.";
const METHODS = [
  ["smc", "sequential Monte Carlo"],
  ["mcmc", "Markov chains"],
] as const;

async function start(place: HTMLElement, context: Context): Promise<void> {
  const { query, signal } = context;
  const [trials, library] = await Promise.all([
    trialSource(query.get("job"), signal),
    effectLibrary(signal),
  ]);
  const effects = effectSets(library, query.get("effects"), "sets", "Effects whose parameters are inferred together with the latents, such as drag. Diagnose finds which ones your trials need.", "Effects to infer");
  const number = numberFields(query);
  const draws = number("Samples", "draws", "1024", "At least 400 effective ones are needed; more take longer, in proportion.");
  const seed = number("Seed", "seed", "0", "The same seed gives the same samples.");
  const method = choiceField("Method", "method", METHODS, query.get("method"), { help: "Sequential Monte Carlo also estimates the evidence and finds several modes." });
  const compare = checkField("Compare with the model without these effects", "compare", query.has("compare"), { help: "Both are weighted by their evidence." });
  const discrepancy = checkField("Also sample an unknown force field", "sample_discrepancy", query.has("sample_discrepancy"), { help: "Wider, more honest intervals where the model lacks something; takes minutes." });
  const more = [...trials.more, method.element, compare.element, discrepancy.element];
  const startJob = async (): Promise<StartedJob> => {
    const names = effects.names();
    const sets = names.length ? { sets: [...(compare.input.checked ? [[]] : []), names] } : {};
    const body = { ...(await trials.request()), ...sets, ...numbersOf([draws, seed]), method: method.input.value, ...(discrepancy.input.checked ? { sample_discrepancy: true } : {}) };
    return ok(api.POST("/v1/posteriors", { body, signal }));
  };
  const example = {
    label: "Try with six bowling trials",
    about: "Measures six trials in a hidden world with drag, then infers friction, restitution, density and the drag; takes about ten seconds.",
    start: (say: (text: string) => void) => startExample(say, signal),
  };
  const page = { kind: KIND, purpose: PURPOSE, example, main: [...trials.main, effects.element, draws.element, seed.element], more };
  await startPage(place, { ...page, fields: [...trials.fields, draws, seed, method, discrepancy], submit: "Infer", start: startJob }, context);
}

async function result(job: Job, context: Context): Promise<ResultPage> {
  const posterior = job.result as unknown as Posterior;
  const config = job.config as { job?: string | null; scene?: string };
  const { families } = await ok(api.GET("/v1/tasks", { signal: context.signal }));
  const family = families.find((f) => f.name === config.scene?.split(":")[0])?.name ?? null;
  const query = { posterior: job.id, ...(family ? { task: `${family}:003` } : {}) };
  const effects = [...new Set(posterior.sets.flatMap((set) => set.effects))].join(",");
  const request = { ...(config.job ? { job: config.job } : {}), ...(effects ? { effects } : {}), draws: String(Object.values(posterior.columns)[0]?.length ?? 1024), seed: String(posterior.seed) };
  const [used, all] = posterior.trials;
  return {
    headline: headline(posterior),
    notes: [
      h("p", {}, h("span", { class: `mark ${posterior.converged ? "yes" : "no"}` }, posterior.converged ? "converged" : "not converged"), " ", convergenceText(posterior)),
      ...posterior.warnings.map((warning) => h("p", { class: "warning" }, ...codeText(warningText(warning)))),
      lacksForce(posterior) ? h("p", {}, h("a", { href: link("diagnose") }, "Search for the missing effect in Diagnose"), ", then infer it here; or ", h("a", { href: link("posterior", [], { ...request, sample_discrepancy: "1" }) }, "sample an unknown force field"), ".") : null,
      h("p", { class: "soft" }, `${used === all ? `${all} trials` : `${used} of ${all} trials`} used; noise of a measured coordinate ${(posterior.noise_m * 1e3).toPrecision(2)} mm.`),
    ],
    steps: [
      h("a", { class: "button main", href: link("plan", [], query) }, "Plan with this posterior"),
      h("a", { class: "button", href: link("design", [], query) }, "Design the next experiment with it"),
      family ? trainButton(job, family, context) : null,
    ],
    parts: [],
    substitutes: [parameterTable(posterior)],
    request,
  };
}

/** Starts a training in samples of the posterior and opens it. */
function trainButton(job: Job, family: string, context: Context): HTMLElement {
  const button = h("button", { type: "button", title: `Trains a policy for ${family} in worlds sampled from this posterior` }, "Train with it");
  button.addEventListener("click", () => {
    button.disabled = true;
    put(button, "Starting…");
    const body = { task: family, posterior: samplesOf(job.result) as never };
    ok(api.POST("/v1/policies", { body, signal: context.signal }))
      .then((training) => (location.hash = link("train", [training.id])))
      .catch((e: unknown) => {
        button.disabled = false;
        put(button, "Train with it");
        context.fail(e);
      });
  });
  return button;
}
