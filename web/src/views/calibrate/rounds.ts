// The rounds with their proposals and the reasons: chosen actions compared with all candidates, and pictures.

import { type Child, uniqueId, h, put } from "../../dom";
import { short } from "../../parts/slider";
import { picture } from "../../scene/draw";
import { applyAction, unit, valueAt } from "../../scene/action";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";
import { loadTask } from "../play/taskPicker";
import { requestOf, type Round, type EstimationState } from "./estimation";
import { formatNumber } from "./findings";

/** Maximum number of pictures for one round. */
const MAX_PICTURES = 12;

const HEADS = ["Round", "Actions", "Collisions", "Rolling steps", "Residual, m²", "Real interactions"];

/** Criterion of each strategy. */
export const STRATEGIES: Record<string, string> = {
  mixed: "alternately actions with many collisions (for restitution) and with much rolling (for friction)",
  collisions: "the actions with most collisions (for restitution)",
  rolling: "the actions with most rolling (for friction)",
  random: "random actions, as a baseline",
  gradient: "collisions and rolling, weighted by the sensitivity of performance",
  informative: "the actions that leave the least uncertainty about the latents (D-optimal design)",
  probing: "the actions with the largest expected information about latents and parameters",
  success: "the actions with the largest expected information about whether plans succeed",
};

export interface RoundsView {
  element: HTMLElement;
  show: (now: EstimationState) => void;
}

export function roundsView(context: Context): RoundsView {
  const why = h("p", { class: "soft" });
  const body = h("tbody");
  const table = h(
    "table",
    { class: "rounds" },
    h("caption", { class: "unseen" }, "Rounds: chosen actions compared with all candidates, and results"),
    h("thead", {}, h("tr", {}, ...HEADS.map((t) => h("th", { scope: "col" }, t)))),
    body,
  );
  const id = uniqueId("round");
  const choice = h("select", { id });
  const tiles = h("ul", { class: "tiles" });
  const more = h("p", { class: "soft", hidden: true });
  const proposals = h("div", { class: "stack", hidden: true }, h("div", { class: "row" }, h("label", { for: id }, "Proposals of round"), choice), tiles, more);
  let [rounds, shownKey]: [readonly Round[], string] = [[], ""];
  const draw = (): void => {
    const round = rounds.find((r) => String(r.number) === choice.value);
    if (!round) return;
    const now = JSON.stringify([round.number, round.proposals.map((p) => p.measured)]);
    if (now === shownKey) return;
    shownKey = now;
    put(tiles, ...round.proposals.slice(0, MAX_PICTURES).map((p) => tile(p, context)));
    more.hidden = round.proposals.length <= MAX_PICTURES;
    put(more, `The first ${MAX_PICTURES} of ${round.proposals.length}.`);
  };
  choice.addEventListener("change", draw);
  const show = (now: EstimationState): void => {
    const strategy = requestOf(now.job).strategy ?? "mixed";
    put(why, `${strategy}: ${STRATEGIES[strategy] ?? ""}. The table gives simulated means of the chosen actions, with those of all candidates in brackets.`);
    // If the user selected an earlier round, keep it selected.
    const follow = !rounds.length || choice.value === String(rounds.at(-1)!.number);
    const selectedRound = follow ? String(now.rounds.at(-1)?.number ?? "") : choice.value;
    rounds = now.rounds;
    put(body, ...rounds.map(row));
    put(choice, ...rounds.map((r) => h("option", { value: r.number, selected: String(r.number) === selectedRound }, r.number + 1)));
    proposals.hidden = rounds.length === 0;
    draw();
  };
  return { element: h("section", { class: "card stack", "aria-label": "Rounds" }, h("h2", {}, "Proposed actions and reasons"), why, table, proposals), show };
}

function row(round: Round): HTMLElement {
  const c = round.choice;
  const groupText = c.groups ? ` (${c.groups.collisions} for collisions, ${c.groups.rolling} for rolling)` : "";
  // Narrow screens have no column headings: each cell carries its own.
  const cell = (column: number, ...children: Child[]): HTMLElement => h("td", { "data-head": HEADS[column] }, ...children);
  const meanCell = (column: number, chosen: number, all: number): HTMLElement => cell(column, formatNumber(chosen), h("span", { class: "soft" }, ` (${formatNumber(all)})`));
  return h(
    "tr",
    { "data-round": round.number },
    h("th", { scope: "row" }, round.number + 1),
    cell(1, `${c.actions} on ${c.tasks === 1 ? "1 task" : `${c.tasks} tasks`}${groupText}`, ...c.expected.map(expectedGain)),
    meanCell(2, c.collisions, c.candidate_collisions),
    meanCell(3, c.rolling_steps, c.candidate_rolling_steps),
    cell(4, typeof round.residual === "number" ? formatNumber(round.residual) : round.fitted ? "nothing measured" : "…"),
    cell(5, round.interactions),
  );
}

/** Expected reduction of the uncertainty of a latent. */
function expectedGain(e: Round["choice"]["expected"][number]): HTMLElement {
  return h("span", { class: "soft hope" }, `${e.name}: ±${formatNumber(e.before)} to ±${formatNumber(e.after)} expected`);
}

function tile(proposal: Round["proposals"][number], context: Context): HTMLElement {
  const place = h("span", { class: "thumb" });
  const mark = proposal.measured === true ? "measured" : proposal.measured === false ? "not possible" : "open";
  sceneOfTask(proposal.task, context.signal)
    .then((s) => put(place, picture(applyAction(s, proposal.action), `${taskName(proposal.task)}, proposal ${proposal.number}: ${actionText(s, proposal.action)}`).svg))
    .catch(context.fail);
  return h("li", { class: "tile" }, place, h("span", {}, `${proposal.number}: ${taskName(proposal.task)}`), h("span", { class: "soft" }, mark));
}

const scenes = new Map<string, Promise<Scene>>();

/** The scene of a task, read once. */
export function sceneOfTask(task: string, signal: AbortSignal): Promise<Scene> {
  const cached = scenes.get(task);
  if (cached) return cached;
  const pending = loadTask(task, signal).then((t) => t.scene);
  scenes.set(task, pending);
  // Failed or aborted requests are repeated next time.
  pending.catch(() => scenes.delete(task));
  return pending;
}

/** Name of a task for people: scenes without a family bear their own. */
export function taskName(task: string): string {
  return task.replace(/^custom:/, "");
}

/** Remembers the scene of an estimation without a task, under the server's name of it. */
export function rememberScene(scene: Scene): void {
  scenes.set(`custom:${scene.name || "scene"}`, Promise.resolve(scene));
}

/** Text of an action's values. */
export function actionText(scene: Scene, action: readonly number[]): string {
  const set = (scene.action?.components ?? []).map((c, i) => `${c.target} ${c.set} ${short(valueAt(c, action[i] ?? 0), unit(c))}`);
  return set.join(", ");
}
