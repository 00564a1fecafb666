// Policies beside each other and beside chance: evaluated in one world, solved against attempts, with bands.

import { api, ok, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { h, put, set } from "../../dom";
import { key } from "../../parts/series";
import { short } from "../../parts/slider";
import { type Context, link } from "../../view";
import { choice, given, named, number, refused } from "./fields";
import { figures } from "./figures";
import { asked, auccess, better, CHANCE, curve, evaluation, type Evaluation, fits, type Interval, interval, schooling, type Setting } from "./scores";

type Job = Schema<"JobOut">;

/** What is compared. */
export interface Compared {
  family: string;
  policies: Schema<"PolicyOut">[];
  worlds: Schema<"WorldOut">[];
  /** Evaluations and steps of learning on, ended or not. */
  evaluations: Job[];
  learnt: Job[];
  /** Where to begin: an evaluation, or a policy. */
  job: Job | null;
  policy: string | null;
}

/** The comparison. */
export function compare(of: Compared, context: Context): HTMLElement {
  const start = of.job ? asked(of.job) : null;
  const world = choice("World", "world", of.worlds.map((w) => [w.id, named(w)]));
  const split = choice("Tasks", "split", [["test", "test"], ["validation", "validation"], ["train", "training"]]);
  const attempts = number("Attempts a task", "attempts", { value: start?.attempts ?? 100 });
  const seed = number("Candidates' seed", "seed", { value: of.job?.seed ?? 0 });
  if (start && of.worlds.some((w) => w.id === start.world)) world.input.value = start.world;
  if (start?.split) split.input.value = start.split;
  const rows: Row[] = [CHANCE, ...of.policies.filter((p) => p.task === of.family).map((p) => p.id)].map((id, look) => {
    return row(id, look, of.policies.find((p) => p.id === id) ?? null);
  });
  const done: Evaluation[] = of.evaluations.map(evaluation).filter((e) => e !== null);
  const under = new Map(of.evaluations.filter((job) => !ended(job)).map((job) => [job.id, job]));
  const setting = (): Setting => ({ world: world.input.value, split: split.input.value, attempts: given(attempts) ?? 100, seed: given(seed) ?? 0 });
  // The newest counts: a policy's weights may have been replaced.
  const found = (id: string): Evaluation | undefined => done.filter((e) => e.policy === id && fits(e, setting())).at(-1);
  const running = (id: string): Job | undefined => [...under.values()].find((job) => asked(job).policy === id);
  const told = figures();
  const button = h("button", { type: "button", class: "main" }, "Evaluate what is ticked");
  const spent = h("p", { class: "soft", role: "status" });
  const show = (): void => {
    const chance = found(CHANCE);
    for (const one of rows) fill(one, found(one.id), chance, running(one.id));
    const ticked = rows.filter((one) => one.tick.checked);
    const drawn = ticked.flatMap((one) => {
      const e = found(one.id);
      return e ? [{ id: one.id, look: one.look, training: one.training, schooling: schooling(of.policies, one.id), evaluation: e, curve: curve(e.solvedAt, e.attempts), auccess: auccess(e.solvedAt) }] : [];
    });
    told.draw(drawn, chance, of.learnt, of.worlds.find((w) => w.id === world.input.value)?.kind === "real");
    const lacking = ticked.filter((one) => !found(one.id)).length;
    button.disabled = lacking === 0;
    const known = of.worlds.find((w) => w.id === world.input.value);
    if (known) put(spent, `${known.kind === "real" ? "Real interactions" : "Interactions"} spent in ${known.id}: `, h("strong", {}, known.interactions), lacking ? `. An evaluation spends up to ${given(attempts) ?? 100} a task.` : ".");
  };
  const refresh = async (): Promise<void> => {
    const now = await ok(api.GET("/v1/worlds/{id}", { params: { path: { id: world.input.value } }, signal: context.signal }));
    of.worlds = of.worlds.map((w) => (w.id === now.id ? now : w));
    show();
  };
  const watch = (job: Job): void => {
    under.set(job.id, job);
    follow(`/v1/jobs/${encodeURIComponent(job.id)}/events`, (event) => {
      const now = JSON.parse(event.data) as Job;
      under.set(job.id, now);
      if (event.event === "done") {
        under.delete(job.id);
        const e = evaluation(now);
        if (e) done.push(e);
        if (now.state === "failed") context.fail(new Error(`${now.id} failed: ${now.error?.detail ?? "without a word"}`));
        context.say(e ? `${e.policy}: AUCCESS ${short(e.auccess)}` : `${now.id} ${now.state}`);
        refresh().catch(context.fail);
      }
      show();
    }, context.signal).catch(context.fail);
  };
  const fields = [world, split, attempts, seed];
  const ask = async (): Promise<void> => {
    for (const one of rows) {
      if (!one.tick.checked || found(one.id) || running(one.id)) continue;
      const body = { ...setting(), split: split.input.value as Schema<"SplitIn"> };
      watch(await ok(api.POST("/v1/policies/{id}/evaluate", { params: { path: { id: one.id } }, body, signal: context.signal })));
    }
  };
  button.addEventListener("click", () => {
    button.disabled = true;
    context.fail(null);
    for (const one of fields) one.refuse(null);
    ask()
      .catch((e: unknown) => refused(fields, e) || context.fail(e))
      .finally(show);
  });
  for (const one of fields) one.input.addEventListener("change", () => (show(), refresh().catch(context.fail)));
  for (const one of rows) {
    one.tick.checked = one.id === of.policy || one.id === CHANCE || one.id === start?.policy || Boolean(found(one.id) ?? running(one.id));
    one.tick.addEventListener("change", show);
  }
  for (const job of [...under.values()]) watch(job);
  show();
  const heads = ["Show", "Policy", "AUCCESS", "Over chance", "At 1", "Within 10", "Spent"];
  const head = h("thead", {}, h("tr", {}, ...heads.map((t) => h("th", { scope: "col" }, t))));
  const table = h("table", { class: "policies" }, h("caption", { class: "unseen" }, `Policies of ${of.family}, as evaluated in the world chosen`), head, h("tbody", {}, ...rows.map((one) => one.element)));
  return h(
    "div",
    { class: "stack" },
    h("div", { class: "four" }, world.element, split.element, attempts.element, seed.element),
    h("div", { class: "train-sides" }, h("div", {}, h("div", { class: "wide" }, table), h("div", { class: "row" }, button, spent)), told.element),
  );
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
  const about = policy ? `${policy.training.replaceAll("_", " ")}; ${policy.about.replace(/^.*hidden units, /, "")}` : "any order: what every policy must beat";
  const name = h("th", { scope: "row" }, h("span", { class: "name" }, key(look), named), " ", h("span", { class: "soft" }, about));
  const element = h("tr", { "data-policy": id }, h("td", {}, tick), name, ...cells);
  return { id, look, training: policy?.training ?? "none", element, tick, cells };
}

/** What is known of a policy in the setting chosen, or how far its evaluation is. */
function fill(row: Row, e: Evaluation | undefined, chance: Evaluation | undefined, job: Job | undefined): void {
  if (!e) {
    const { done, total } = job?.progress ?? { done: 0, total: 0 };
    const bar = job ? h("progress", { max: Math.max(1, total), value: done, "aria-label": `Progress of ${job.id}` }) : h("span", { class: "soft" }, "not evaluated");
    row.cells.forEach((cell, i) => put(cell, i === 0 ? bar : null));
    return;
  }
  const solved = curve(e.solvedAt, e.attempts);
  const ahead = chance && e !== chance ? better(e.solvedAt, chance.solvedAt) : null;
  const words = [within(auccess(e.solvedAt)), ahead ? within(ahead, true) : "", percent(solved[0]), percent(solved[9]), e.interactions];
  const labels = ["AUCCESS", "over chance", "solved at 1", "within 10", "spent"];
  row.cells.forEach((cell, i) => put(set(cell, { "data-label": labels[i]! }), words[i] === "" ? null : words[i]));
}

/** A value, and under it between what it lies. */
function within(of: Interval, signed = false): HTMLElement {
  const [value, ...rest] = interval(of, signed).split(" ");
  return h("span", { class: "within" }, value, h("span", { class: "soft" }, ` ${rest.join(" ")}`));
}

function percent(share: Interval | undefined): string {
  return share ? `${Math.round(100 * share.value)} %` : "";
}

function ended(job: Job): boolean {
  return ["succeeded", "failed", "cancelled"].includes(job.state);
}
