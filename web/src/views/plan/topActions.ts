// The ten best actions: success probability as a bar, a button that tries each, and its address in Play.

import { h, set } from "../../dom";
import type { Scene } from "../../scene/types";
import { actionText } from "../analysis/actionText";
import { playLink } from "../analysis/tryPanel";
import { type Plan, probabilityText, type RankedAction, successProbability } from "./result";

/** Maximum number of actions in the list. */
const MAX_ACTIONS = 10;

/** The list; `onTry` gets the action of a button. */
export function topActions(plan: Plan, scene: Scene, onTry: (action: readonly number[], name: string) => void): HTMLElement {
  const buttons: HTMLButtonElement[] = [];
  const rows = plan.actions.slice(0, MAX_ACTIONS).map((action, i) => {
    const name = `Action ${i + 1}`;
    const button = h("button", { type: "button", "aria-label": `Try action ${i + 1}`, "aria-pressed": "false" }, "Try");
    buttons.push(button);
    button.addEventListener("click", () => {
      for (const other of buttons) set(other, { "aria-pressed": String(other === button) });
      onTry(action.action, name);
    });
    const play = h("a", { href: playLink(plan.task, action.action), "aria-label": `Open action ${i + 1} in Play` }, "Play");
    return h("li", {}, h("span", { class: "rank" }, `${i + 1}`), bar(action), h("span", { class: "soft values" }, actionText(scene, action.action)), h("span", { class: "row" }, button, play));
  });
  return h("section", { class: "card stack", "aria-label": "Best actions" }, h("h2", {}, "Best actions"), h("p", { class: "soft" }, "Probability of solving the task, ± standard error."), h("ol", { class: "top-actions" }, ...rows));
}

function bar(action: RankedAction): HTMLElement {
  const fill = h("span", { class: "fill" });
  fill.style.width = `${100 * successProbability(action)}%`;
  return h("span", { class: "probability" }, h("span", { class: "bar-track", "aria-hidden": "true" }, fill), h("strong", {}, probabilityText(action)));
}
