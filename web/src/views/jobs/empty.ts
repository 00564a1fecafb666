// The list of jobs without a row: what to do next.

import { api, ok } from "../../api/client";
import { h, put } from "../../dom";
import { type Context, link } from "../../view";
import { kindOf } from "./job";

/** The filters of an empty list, and the number of jobs loaded. */
export interface EmptyList {
  loaded: number;
  state: string;
  kind: string;
  text: string;
}

/** An estimation that takes seconds. */
const EXAMPLE = { task: "basketball", rounds: 3, actions: 3, samples: 20, seed: 1 };

/** Explains an empty list; without any job, it offers an example. Does nothing if the text would be the same. */
export function emptyList(place: HTMLElement, of: EmptyList, changed: () => void, context: Context): void {
  const key = JSON.stringify(of);
  if (place.dataset.key === key) return;
  place.dataset.key = key;
  if (of.loaded) return void put(place, h("p", { class: "soft" }, `No job on this page contains “${of.text.trim()}”.`));
  if (of.state || of.kind) {
    const kind = of.kind ? `${kindOf({ kind: of.kind }).toLowerCase()}` : "job";
    return void put(place, h("p", { class: "soft" }, `No ${kind} is ${of.state || "listed"}.`));
  }
  const button = h("button", { type: "button", class: "main" }, "Start an example");
  button.addEventListener("click", () => {
    button.disabled = true;
    context.fail(null);
    ok(api.POST("/v1/iplw", { body: EXAMPLE, signal: context.signal }))
      .then(changed)
      .catch((e: unknown) => ((button.disabled = false), context.fail(e)));
  });
  const starts = [
    ["calibrate", "Calibrate", "estimates friction, restitution and density from few real interactions."],
    ["diagnose", "Diagnose", "finds the forces that a simulation lacks, from measured trials."],
    ["train", "Train", "trains policies and evaluates them."],
  ] as const;
  put(
    place,
    h("h2", {}, "No jobs yet"),
    h("p", {}, "Everything that takes longer than a moment is a job: it runs on the server, survives restarts, and stays here with its result and report."),
    h("ul", {}, ...starts.map(([view, title, text]) => h("li", {}, h("a", { href: link(view) }, title), ` ${text}`))),
    h("div", { class: "row" }, button, h("span", { class: "soft" }, "an estimation in a simulated world, about ten seconds")),
  );
}
