// Ask and tell: proposals with pictures of the initial state; results are uploaded as a file or entered by hand.

import { api, ok, type Schema } from "../../api/client";
import { hasEnded } from "../../api/jobState";
import { h, put } from "../../dom";
import { latest } from "../../parts/latest";
import { saveFile } from "../../parts/share";
import { picture } from "../../scene/draw";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";
import { type EstimationState } from "./estimation";
import { trialsUpload } from "./trialsUpload";
import { actionText, taskName } from "./rounds";
import { InvalidCellError, resultTable } from "./resultTable";

type Proposals = Schema<"Proposals">;
type Proposal = Schema<"ProposalOut">;
type Tell = Schema<"TrialsSubmission">;

/** Maximum number of proposals displayed; for more, use the file. */
const MAX_CARDS = 60;

export interface AskTellView {
  element: HTMLElement;
  show: (now: EstimationState) => void;
}

export function askTellView(id: string, context: Context): AskTellView {
  const path = { id };
  const { signal } = context;
  const words = h("p", { class: "soft", role: "status" });
  const list = h("ul", { class: "asked" });
  const rest = h("p", { class: "soft", hidden: true });
  const file = trialsUpload(id, () => proposals, (now) => onSubmitted(now), context);
  const close = h("button", { type: "button" }, "Close the round now");
  const saveJson = h("button", { type: "button" }, "Save the proposals (JSON)");
  const saveCsv = h("button", { type: "button" }, "Save a CSV template");
  const tools = h("div", { class: "row" }, saveJson, saveCsv, close);
  const element = h("section", { class: "card stack", hidden: true, "aria-label": "Proposals" }, h("h2", {}, "Proposed experiments"), words, tools, file.element, list, rest);
  let [proposals, shownKey]: [Proposals | null, string] = [null, ""];
  const onSubmitted = (now: Schema<"SubmissionStatus">): void => {
    context.say(`Round ${now.round + 1}: ${now.answered} measured, ${now.failed} not possible, ${now.open} open.`);
    refresh(null);
  };
  const submit = async (body: Tell): Promise<void> => {
    const round = proposals ? { round: proposals.round } : {};
    onSubmitted(await ok(api.POST("/v1/iplw/{id}/trials", { params: { path }, body: { ...round, ...body }, signal })));
  };
  const refresh = latest<null>(async () => {
    try {
      showProposals(await ok(api.GET("/v1/iplw/{id}/proposals", { params: { path }, signal })));
    } catch (e) {
      context.fail(e);
    }
  });
  const showProposals = (now: Proposals): void => {
    proposals = now;
    const waits = now.state === "waiting";
    [tools.hidden, file.element.hidden, list.hidden] = [!waits, !waits, !waits];
    const key = JSON.stringify([now.round, now.state]);
    if (key !== shownKey) put(list, ...now.proposals.slice(0, MAX_CARDS).map((p) => card(p, submit, context)));
    shownKey = key;
    rest.hidden = !waits || now.proposals.length <= MAX_CARDS;
    put(rest, `The first ${MAX_CARDS} of ${now.proposals.length} are displayed; the files contain all.`);
    for (const p of now.proposals) list.querySelector(`[data-proposal="${p.number}"]`)?.classList.toggle("answered", p.answered);
    for (const p of now.proposals) mark(list.querySelector(`[data-proposal="${p.number}"] .tag`), p.answered);
    if (waits) {
      const open = now.proposals.filter((p) => !p.answered).length;
      put(words, `Round ${now.round + 1}: ${open} of ${now.proposals.length} proposals are open. Carry them out and submit the measurements; then the round is fitted and the next one starts.`);
    } else {
      put(words, hasEnded(now) ? "No more experiments are needed." : "The round is being fitted or the next one selected.");
    }
  };
  close.addEventListener("click", () => {
    context.fail(null);
    submit({ close: true }).catch(context.fail);
  });
  saveJson.addEventListener("click", () => proposals && saveFile(`${id}-round-${proposals.round + 1}.json`, "application/json", JSON.stringify(proposals.proposals, null, 2)));
  saveCsv.addEventListener("click", () => proposals && saveFile(`${id}-round-${proposals.round + 1}.csv`, "text/csv", blankTrials(proposals.proposals)));
  return {
    element,
    show: (now) => {
      element.hidden = hasEnded(now.job);
      if (!element.hidden) refresh(null);
    },
  };
}

function mark(tag: Element | null, answered: boolean): void {
  if (!tag) return;
  tag.className = `tag ${answered ? "good" : "warn"}`;
  put(tag, answered ? "answered" : "open");
}

function card(p: Proposal, submit: (body: Tell) => Promise<void>, context: Context): HTMLElement {
  const scene = p.scene as unknown as Scene;
  const what = actionText(scene, p.action);
  const drawing = picture(scene, `Proposal ${p.number}, ${taskName(p.task)}, initial state: ${what}`);
  const form = resultTable(p.number, scene.bodies.map((b) => b.name));
  const send = h("button", { type: "button", class: "main" }, "Submit");
  const failed = h("button", { type: "button", "aria-label": `Proposal ${p.number} could not be carried out` }, "Could not be carried out");
  const manualEntry = h("details", {}, h("summary", {}, `Enter the measurements of ${p.number}`), form.element, h("div", { class: "row" }, send, form.more));
  const runAction = (button: HTMLButtonElement, what: () => Promise<void>, onError: (e: unknown) => void): void => {
    button.disabled = true;
    context.fail(null);
    what()
      .catch(onError)
      .finally(() => (button.disabled = false));
  };
  send.addEventListener("click", () =>
    runAction(
      send,
      async () => {
        await submit({ trials: [form.read()] });
        form.showError(null);
        manualEntry.open = false;
      },
      (e) => e instanceof InvalidCellError || form.showError(e),
    ),
  );
  failed.addEventListener("click", () => runAction(failed, () => submit({ failed: [p.number] }), context.fail));
  const title = h("div", { class: "row between" }, h("h3", {}, `Proposal ${p.number}: ${taskName(p.task)}`), h("span", { class: "tag" }));
  return h("li", { class: "card stack", "data-proposal": p.number }, title, drawing.svg, h("p", {}, what), manualEntry, h("div", { class: "row" }, failed));
}

/** A trials file in which only the positions are missing. */
export function blankTrials(proposals: readonly Pick<Proposal, "number" | "scene" | "observe_at">[]): string {
  const rows = proposals.flatMap((p) => {
    const bodies = (p.scene as unknown as Scene).bodies;
    return p.observe_at.flatMap((t) => bodies.map((b) => `${p.number},${Number(t.toFixed(6))},${b.name},,`));
  });
  return ["trial,t,body,x,y", ...rows, ""].join("\n");
}
