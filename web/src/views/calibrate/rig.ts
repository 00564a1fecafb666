// A rig: proposals with pictures of the scene as it is to be let go, and what was measured, as a file or by hand.

import { api, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import { latest } from "../../parts/latest";
import { picture } from "../../scene/draw";
import type { Scene } from "../../scene/types";
import type { Context } from "../../view";
import { ended, type Standing } from "./course";
import { dropped } from "./drop";
import { placement } from "./proposed";
import { Refused, sheet } from "./sheet";

type Proposals = Schema<"Proposals">;
type Proposal = Schema<"ProposalOut">;
type Tell = Schema<"TellIn">;

const ENDED = ["succeeded", "failed", "cancelled"];
/** Proposals that are shown; a robot's hundreds are read by a program. */
const CARDS = 60;

export interface Rig {
  element: HTMLElement;
  show: (now: Standing) => void;
}

export function rig(id: string, context: Context): Rig {
  const path = { id };
  const { signal } = context;
  const words = h("p", { class: "soft", role: "status" });
  const list = h("ul", { class: "asked" });
  const rest = h("p", { class: "soft", hidden: true });
  const file = dropped(id, () => proposals, (now) => came(now), context);
  const close = h("button", { type: "button" }, "End the round with what there is");
  const saved = h("button", { type: "button" }, "Save the proposals (JSON)");
  const blank = h("button", { type: "button" }, "Save a CSV to fill in");
  const tools = h("div", { class: "row" }, saved, blank, close);
  const element = h("section", { class: "card stack", hidden: true, "aria-label": "Proposals" }, h("h2", {}, "To be carried out on your rig"), words, tools, file.element, list, rest);
  let [proposals, shown]: [Proposals | null, string] = [null, ""];
  const came = (now: Schema<"Told">): void => {
    context.say(`Round ${now.round + 1}: ${now.answered} measured, ${now.failed} not possible, ${now.open} open.`);
    refresh(null);
  };
  const tell = async (body: Tell): Promise<void> => {
    const round = proposals ? { round: proposals.round } : {};
    came(await ok(api.POST("/v1/iplw/{id}/trials", { params: { path }, body: { ...round, ...body }, signal })));
  };
  const refresh = latest<null>(async () => {
    try {
      shows(await ok(api.GET("/v1/iplw/{id}/proposals", { params: { path }, signal })));
    } catch (e) {
      context.fail(e);
    }
  });
  const shows = (now: Proposals): void => {
    proposals = now;
    const waits = now.state === "waiting";
    [tools.hidden, file.element.hidden, list.hidden] = [!waits, !waits, !waits];
    const key = JSON.stringify([now.round, now.state]);
    if (key !== shown) put(list, ...now.proposals.slice(0, CARDS).map((p) => card(p, tell, context)));
    shown = key;
    rest.hidden = !waits || now.proposals.length <= CARDS;
    put(rest, `The first ${CARDS} of ${now.proposals.length} are shown; the files have all of them.`);
    for (const p of now.proposals) list.querySelector(`[data-proposal="${p.number}"]`)?.classList.toggle("answered", p.answered);
    for (const p of now.proposals) mark(list.querySelector(`[data-proposal="${p.number}"] .tag`), p.answered);
    if (waits) {
      const open = now.proposals.filter((p) => !p.answered).length;
      put(words, `Round ${now.round + 1}: ${open} of ${now.proposals.length} proposals are open. Carry them out, and send what was measured; then the round is fitted and the next one comes.`);
    } else {
      put(words, ENDED.includes(now.state) ? "Nothing more is asked for." : "The round is being fitted, or the next one chosen.");
    }
  };
  close.addEventListener("click", () => {
    context.fail(null);
    tell({ close: true }).catch(context.fail);
  });
  saved.addEventListener("click", () => proposals && save(`${id}-round-${proposals.round + 1}.json`, "application/json", JSON.stringify(proposals.proposals, null, 2)));
  blank.addEventListener("click", () => proposals && save(`${id}-round-${proposals.round + 1}.csv`, "text/csv", toFill(proposals.proposals)));
  return {
    element,
    show: (now) => {
      element.hidden = ended(now.job);
      if (!element.hidden) refresh(null);
    },
  };
}

function mark(tag: Element | null, answered: boolean): void {
  if (!tag) return;
  tag.className = `tag ${answered ? "good" : "warn"}`;
  put(tag, answered ? "answered" : "open");
}

function card(p: Proposal, tell: (body: Tell) => Promise<void>, context: Context): HTMLElement {
  const scene = p.scene as unknown as Scene;
  const what = placement(scene, p.action);
  const drawn = picture(scene, `Proposal ${p.number}, ${p.task}, everything placed: ${what}`);
  const form = sheet(p.number, scene.bodies.map((b) => b.name));
  const send = h("button", { type: "button", class: "main" }, "Send");
  const failed = h("button", { type: "button", "aria-label": `Proposal ${p.number} could not be carried out` }, "Could not be carried out");
  const hand = h("details", {}, h("summary", {}, `Fill in what was measured of ${p.number}`), form.element, h("div", { class: "row" }, send, form.more));
  const doing = (button: HTMLButtonElement, what: () => Promise<void>, wrong: (e: unknown) => void): void => {
    button.disabled = true;
    context.fail(null);
    what()
      .catch(wrong)
      .finally(() => (button.disabled = false));
  };
  send.addEventListener("click", () =>
    doing(
      send,
      async () => {
        await tell({ trials: [form.read()] });
        form.refuse(null);
        hand.open = false;
      },
      (e) => e instanceof Refused || form.refuse(e),
    ),
  );
  failed.addEventListener("click", () => doing(failed, () => tell({ failed: [p.number] }), context.fail));
  const title = h("div", { class: "row between" }, h("h3", {}, `Proposal ${p.number}: ${p.task}`), h("span", { class: "tag" }));
  return h("li", { class: "card stack", "data-proposal": p.number }, title, drawn.svg, h("p", {}, what), hand, h("div", { class: "row" }, failed));
}

/** A trials file in which only places are missing. */
export function toFill(proposals: readonly Pick<Proposal, "number" | "scene" | "observe_at">[]): string {
  const rows = proposals.flatMap((p) => {
    const bodies = (p.scene as unknown as Scene).bodies;
    return p.observe_at.flatMap((t) => bodies.map((b) => `${p.number},${Number(t.toFixed(6))},${b.name},,`));
  });
  return ["trial,t,body,x,y", ...rows, ""].join("\n");
}

function save(name: string, type: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type }));
  h("a", { href: url, download: name }).click();
  URL.revokeObjectURL(url);
}
