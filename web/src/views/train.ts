// Train and compare: a policy is trained while one looks, transferred to the real world, and set beside others and beside chance.
// `#/train` is all of it, `#/train/job-3` with that training or evaluation, `#/train/policy-2` with that policy.

import { all, api, ok, type Schema } from "../api/client";
import { h, put } from "../dom";
import { type Context, link, type View } from "../view";
import { compare, type Comparison } from "./train/compare";
import { choice } from "./train/fields";
import { form } from "./train/form";
import { live } from "./train/live";
import { maps, type Maps } from "./train/map";
import "./train.css";

export const train: View = {
  id: "train",
  title: "Train",
  about: "Train a policy in simulation, watch it learn, and compare what it does in the real world.",
  open,
};

type Job = Schema<"JobOut">;

async function open(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const { families } = await ok(api.GET("/v1/tasks", { signal }));
  const asked = context.rest[0] ?? null;
  const job = asked?.startsWith("job-") ? await ok(api.GET("/v1/jobs/{id}", { params: { path: { id: asked } }, signal })) : null;
  const policy = asked && !job ? await ok(api.GET("/v1/policies/{id}", { params: { path: { id: asked } }, signal })) : null;
  const [known, library] = await Promise.all([
    lists(signal),
    all((cursor) => ok(api.GET("/v1/effects", { params: { query: cursor ? { cursor } : {} }, signal })), (page) => page.effects),
  ]);
  const family = families.find((f) => f.name === about(job, policy, known.worlds, context.query.get("family"))) ?? families[0];
  if (!family) throw new Error("the server has no family of tasks");
  const choose = choice("Family of tasks", "family", families.map((f) => [f.name, f.name] as const));
  choose.input.value = family.name;
  choose.input.addEventListener("change", () => (location.hash = link("train", [], { family: choose.input.value })));
  const of = (name: string): boolean => name === family.name || name.startsWith(`${family.name}:`);
  const worlds = known.worlds.filter((w) => w.task === family.name);
  const [comparing, mapping] = [h("div"), h("div")];
  const none = h("p", { class: "soft" }, "What a training learns is drawn here while it runs.");
  const runs = h("div", { class: "stack", "aria-label": "Trainings", role: "group" }, none);
  const first = policy?.id ?? (job?.result as { policy?: string } | null | undefined)?.policy ?? null;
  const estimations = known.estimations.filter((one) => of(String((one.config as { task?: string }).task)));
  const here = (one: Job): boolean => worlds.some((w) => w.id === (one.config as { world?: string }).world);
  const asking = form({ family, worlds, estimations, library }, (started) => watch(started), context);
  // Anew where something was learned: the policies are others then.
  let shown: Shown | null = null;
  const fill = (policies: Schema<"PolicyOut">[], learnt: Job[], evaluations: Job[], fresh: string | null): void => {
    shown?.left.abort();
    const left = new AbortController();
    const inner: Context = { ...context, signal: AbortSignal.any([signal, left.signal]) };
    const compared = compare({ family: family.name, policies, worlds, evaluations: evaluations.filter(here), learnt, job: job?.kind === "evaluate" ? job : null, policy: fresh, kept: shown?.compared.kept() ?? null }, inner);
    const mapped = maps({ family, policies, worlds: worlds.filter((w) => w.kind === "sim"), policy: fresh, task: shown?.mapped.task() ?? null }, inner);
    shown = { left, compared, mapped };
    put(comparing, compared.element);
    put(mapping, mapped.element);
    asking.learners(policies);
  };
  const watch = (started: Job): void => {
    none.hidden = true;
    runs.prepend(live(started, (made) => {
      // What had ended when the view was opened is shown in it.
      if (!made || ended(started)) return;
      context.say(`${made} is trained.`);
      Promise.all([policiesOf(signal), jobs("learn", signal), jobs("evaluate", signal)]).then(([p, l, e]) => fill(p, l, e, made)).catch(context.fail);
    }, context));
  };
  fill(known.policies, known.learnt, known.evaluations, first);
  const part = (title: string, ...content: HTMLElement[]): HTMLElement => h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content);
  const sides = h("div", { class: "train-sides" }, asking.element, runs);
  put(place, h("div", { class: "train stack" }, h("div", { class: "row" }, choose.element), part("Train", sides), part("Compare", comparing), part("First tries", mapping)));
  const running = known.trainings.filter((one) => !ended(one) && one.id !== job?.id);
  for (const one of running) watch(one);
  if (job && ["train", "learn"].includes(job.kind)) watch(job);
  if (job && !["train", "learn", "evaluate"].includes(job.kind)) throw new Error(`${job.id} is no training and no evaluation`);
}

/** What is built anew when there is another policy. */
interface Shown {
  left: AbortController;
  compared: Comparison;
  mapped: Maps;
}

interface Lists {
  policies: Schema<"PolicyOut">[];
  worlds: Schema<"WorldOut">[];
  trainings: Job[];
  learnt: Job[];
  evaluations: Job[];
  estimations: Job[];
}

async function lists(signal: AbortSignal): Promise<Lists> {
  const [policies, worlds, trained, learnt, evaluations, estimations] = await Promise.all([
    policiesOf(signal),
    all((cursor) => ok(api.GET("/v1/worlds", { params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal })), (page) => page.worlds),
    jobs("train", signal),
    jobs("learn", signal),
    jobs("evaluate", signal),
    jobs("iplw", signal),
  ]);
  const done = estimations.filter((one) => one.state === "succeeded");
  return { policies, worlds, trainings: [...trained, ...learnt], learnt, evaluations, estimations: done };
}

function policiesOf(signal: AbortSignal): Promise<Schema<"PolicyOut">[]> {
  return all((cursor) => ok(api.GET("/v1/policies", { params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal })), (page) => page.policies);
}

/** Most jobs of a kind that are looked at: the newest. */
const LOOKED = 200;

/** The newest jobs of a kind, oldest first. */
async function jobs(kind: string, signal: AbortSignal): Promise<Job[]> {
  const found = await ok(api.GET("/v1/jobs", { params: { query: { kind, order: "newest", limit: LOOKED } }, signal }));
  return found.jobs.reverse();
}

/** The family that an address is about. */
function about(job: Job | null, policy: Schema<"PolicyOut"> | null, worlds: readonly Schema<"WorldOut">[], asked: string | null): string | null {
  if (policy) return policy.task;
  const config = job?.config as { task?: string; world?: string } | undefined;
  if (config?.task) return config.task.split(":")[0]!;
  return worlds.find((w) => w.id === config?.world)?.task ?? asked;
}

function ended(job: Job): boolean {
  return ["succeeded", "failed", "cancelled"].includes(job.state);
}
