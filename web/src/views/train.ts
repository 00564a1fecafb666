// Train and compare: train a policy, transfer it to the real world, and compare it with others and with random actions.
// `#/train` is the whole view, `#/train/job-3` with that training or evaluation, `#/train/policy-2` with that policy.

import { all, api, ok, type Schema } from "../api/client";
import { effectLibrary } from "../api/effects";
import { hasEnded } from "../api/jobState";
import { h, put } from "../dom";
import { type Context, link, type View } from "../view";
import { compare, type Comparison } from "./train/compare";
import { choice } from "./train/requestFields";
import { form } from "./train/form";
import { trainingProgress } from "./train/trainingProgress";
import { actionMaps, type ActionMaps } from "./train/actionMap";
import "./train.css";

export const train: View = {
  id: "train",
  title: "Train",
  about: "Train a policy in simulation and compare its performance in the real world.",
  open,
};

type Job = Schema<"JobOut">;

async function open(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const { families } = await ok(api.GET("/v1/tasks", { signal }));
  const address = context.rest[0] ?? null;
  const job = address?.startsWith("job-") ? await ok(api.GET("/v1/jobs/{id}", { params: { path: { id: address } }, signal })) : null;
  const policy = address && !job ? await ok(api.GET("/v1/policies/{id}", { params: { path: { id: address } }, signal })) : null;
  const [loaded, library] = await Promise.all([
    lists(signal),
    effectLibrary(signal),
  ]);
  const family = families.find((f) => f.name === familyOf(job, policy, loaded.worlds, context.query.get("family"))) ?? families[0];
  if (!family) throw new Error("the server has no task families");
  const choose = choice("Task family", "family", families.map((f) => [f.name, f.name] as const));
  choose.input.value = family.name;
  choose.input.addEventListener("change", () => (location.hash = link("train", [], { family: choose.input.value })));
  const of = (name: string): boolean => name === family.name || name.startsWith(`${family.name}:`);
  const worlds = loaded.worlds.filter((w) => w.task === family.name);
  const [comparing, mapping] = [h("div"), h("div")];
  const none = h("p", { class: "soft" }, "Training curves are displayed here.");
  const runs = h("div", { class: "stack", "aria-label": "Trainings", role: "group" }, none);
  const first = policy?.id ?? (job?.result as { policy?: string } | null | undefined)?.policy ?? null;
  const estimations = loaded.estimations.filter((one) => of(String((one.config as { task?: string }).task)));
  const isOfFamily = (one: Job): boolean => worlds.some((w) => w.id === (one.config as { world?: string }).world);
  const trainingForm = form({ family, worlds, estimations, library }, (started) => watch(started), context);
  // Rebuild after a training: there are new policies.
  let current: RebuiltViews | null = null;
  const rebuild = (policies: Schema<"PolicyOut">[], learningJobs: Job[], evaluations: Job[], fresh: string | null): void => {
    current?.abort.abort();
    const abort = new AbortController();
    const inner: Context = { ...context, signal: AbortSignal.any([signal, abort.signal]) };
    const compared = compare({ family: family.name, policies, worlds, evaluations: evaluations.filter(isOfFamily), learnt: learningJobs, job: job?.kind === "evaluate" ? job : null, policy: fresh, kept: current?.compared.kept() ?? null }, inner);
    const mapped = actionMaps({ family, policies, worlds: worlds.filter((w) => w.kind === "sim"), policy: fresh, task: current?.mapped.task() ?? null }, inner);
    current = { abort: abort, compared, mapped };
    put(comparing, compared.element);
    put(mapping, mapped.element);
    trainingForm.learners(policies);
  };
  const watch = (started: Job): void => {
    none.hidden = true;
    runs.prepend(trainingProgress(started, (made) => {
      // Jobs that ended before are already displayed.
      if (!made || hasEnded(started)) return;
      context.say(`${made} is trained.`);
      Promise.all([policiesOf(signal), jobs("learn", signal), jobs("evaluate", signal)]).then(([p, l, e]) => rebuild(p, l, e, made)).catch(context.fail);
    }, context));
  };
  rebuild(loaded.policies, loaded.learningJobs, loaded.evaluations, first);
  const part = (title: string, ...content: HTMLElement[]): HTMLElement => h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content);
  const sides = h("div", { class: "train-sides" }, trainingForm.element, runs);
  put(place, h("div", { class: "train stack" }, h("div", { class: "row" }, choose.element), part("Train", sides), part("Compare", comparing), part("First attempts", mapping)));
  const running = loaded.trainings.filter((one) => !hasEnded(one) && one.id !== job?.id);
  for (const one of running) watch(one);
  if (job && ["train", "learn"].includes(job.kind)) watch(job);
  if (job && !["train", "learn", "evaluate"].includes(job.kind)) throw new Error(`${job.id} is neither a training nor an evaluation`);
}

/** Parts that are rebuilt when there is a new policy. */
interface RebuiltViews {
  abort: AbortController;
  compared: Comparison;
  mapped: ActionMaps;
}

interface Lists {
  policies: Schema<"PolicyOut">[];
  worlds: Schema<"WorldOut">[];
  trainings: Job[];
  learningJobs: Job[];
  evaluations: Job[];
  estimations: Job[];
}

async function lists(signal: AbortSignal): Promise<Lists> {
  const [policies, worlds, trained, learningJobs, evaluations, estimations] = await Promise.all([
    policiesOf(signal),
    all((cursor) => ok(api.GET("/v1/worlds", { params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal })), (page) => page.worlds),
    jobs("train", signal),
    jobs("learn", signal),
    jobs("evaluate", signal),
    jobs("iplw", signal),
  ]);
  const done = estimations.filter((one) => one.state === "succeeded");
  return { policies, worlds, trainings: [...trained, ...learningJobs], learningJobs: learningJobs, evaluations, estimations: done };
}

function policiesOf(signal: AbortSignal): Promise<Schema<"PolicyOut">[]> {
  return all((cursor) => ok(api.GET("/v1/policies", { params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal })), (page) => page.policies);
}

/** Maximum number of jobs of a kind read, newest first. */
const MAX_JOBS_READ = 200;

/** The newest jobs of a kind, oldest first. */
async function jobs(kind: string, signal: AbortSignal): Promise<Job[]> {
  const response = await ok(api.GET("/v1/jobs", { params: { query: { kind, order: "newest", limit: MAX_JOBS_READ } }, signal }));
  return response.jobs.reverse();
}

/** The family that the address refers to. */
function familyOf(job: Job | null, policy: Schema<"PolicyOut"> | null, worlds: readonly Schema<"WorldOut">[], address: string | null): string | null {
  if (policy) return policy.task;
  const config = job?.config as { task?: string; world?: string } | undefined;
  if (config?.task) return config.task.split(":")[0]!;
  return worlds.find((w) => w.id === config?.world)?.task ?? address;
}
