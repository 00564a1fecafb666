// Experiments as cards: picture, action, expected information, and buttons to try it.

import { type Child, h } from "../../dom";
import { short } from "../../parts/slider";
import { applyAction } from "../../scene/action";
import { picture } from "../../scene/draw";
import type { Context } from "../../view";
import { actionText, capital, enumeration, percent } from "../analysis/actionText";
import { playLink } from "../analysis/tryPanel";
import { loadTask } from "../play/taskPicker";
import { type Experiment, narrowingTexts, nats, parameterName, unchangedText } from "./result";

/** Cards of experiments in their order; `onTry` gets the experiment of a button. */
export async function experimentCards(experiments: readonly Experiment[], onTry: (experiment: Experiment, name: string) => void, context: Context): Promise<HTMLElement> {
  const cards = await Promise.all(experiments.map((experiment, i) => card(experiment, i, onTry, context)));
  return h("div", { class: "experiment-cards" }, ...cards);
}

async function card(experiment: Experiment, index: number, onTry: (experiment: Experiment, name: string) => void, context: Context): Promise<HTMLElement> {
  const name = `Experiment ${index + 1}`;
  const { scene } = await loadTask(experiment.task, context.signal);
  const drawing = picture(applyAction(scene, experiment.action), `${name} in ${experiment.task}, before the start`);
  const button = h("button", { type: "button", "aria-label": `Try ${name.toLowerCase()}` }, "Try");
  button.addEventListener("click", () => onTry(experiment, name));
  const play = h("a", { href: playLink(experiment.task, experiment.action), "aria-label": `Try in Play: ${name.toLowerCase()}` }, "Try in Play");
  const effect = narrowingTexts(experiment);
  const why = effect.length ? `${capital(enumeration(effect))}.` : "No single parameter becomes much more precise; combinations of them do.";
  const information = h("p", {}, h("strong", {}, `${experiment.information.toFixed(1)} ± ${nats(experiment.standard_error)}`), " of information", index > 0 && experiment.adds !== null ? `, of which ${nats(experiment.adds)} beyond the experiments before it.` : ".");
  const right = experiment.right ? h("p", {}, `Chance of the right answer: ${percent(experiment.right[0])} now, ${percent(experiment.right[1])} afterwards.`) : null;
  return h(
    "section",
    { class: "card stack experiment", "aria-label": name },
    h("h3", {}, name, h("span", { class: "soft" }, ` ${experiment.task}`)),
    drawing.svg,
    h("p", {}, why, " ", unchangedText(experiment)),
    information,
    right,
    h("p", { class: "soft" }, actionText(scene, experiment.action)),
    h("p", { class: "soft" }, ...motionText(experiment)),
    expectedTable(experiment),
    h("div", { class: "row" }, button, play),
  );
}

function motionText({ collisions, rolling_s }: Experiment): Child[] {
  return [`On average ${Number(collisions.toFixed(1))} ${collisions === 1 ? "collision" : "collisions"} between bodies, and ${rolling_s.toFixed(0)} s on surfaces, summed over the bodies.`];
}

/** Uncertainty of each parameter before and after. */
function expectedTable(experiment: Experiment): HTMLElement | null {
  if (!experiment.expected.length) return null;
  const rows = experiment.expected.map((e) => h("tr", {}, h("th", { scope: "row" }, parameterName(e.name)), h("td", {}, `± ${short(e.before)}`), h("td", {}, `± ${short(e.after)}`)));
  const heads = ["Parameter", "Now", "Afterwards"].map((text) => h("th", { scope: "col" }, text));
  return h("details", {}, h("summary", {}, "Uncertainty before and after"), h("table", {}, h("thead", {}, h("tr", {}, ...heads)), h("tbody", {}, ...rows)));
}
