// Real over simulated: the trials that the estimate explains worst, as pictures, and one of them as a film.

import { api, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import { short } from "../../parts/slider";
import { colours } from "../../scene/colour";
import { line, picture } from "../../scene/draw";
import { type Film, pathUntil } from "../../scene/film";
import { applyAction } from "../../scene/action";
import type { Context } from "../../view";
import { stage } from "../play/stage";
import { ended, known, physics, type Standing } from "./course";
import { scene } from "./proposed";
import { apart, film, places } from "./tracks";

type Trial = Schema<"TrialOut">;
type Physics = ReturnType<typeof physics>;

/** Most trials that are simulated again, the newest. */
const MOST = 200;
/** Trials that are shown. */
const SHOWN = 6;
/** Time between two samples of a film, s: finer than a screen shows. */
const SAMPLES = 1 / 60;

interface Compared {
  trial: Trial;
  /** Root mean square of the distance, m. */
  apart: number;
}

export interface Worst {
  element: HTMLElement;
  show: (now: Standing) => void;
}

export function worst(context: Context): Worst {
  const button = h("button", { type: "button" }, "Compare now");
  const words = h("p", { class: "soft", role: "status" });
  const bar = h("progress", { hidden: true, "aria-label": "Trials simulated again" });
  const tiles = h("ul", { class: "tiles worst" });
  const large = h("div", {});
  const about = h("p", { class: "soft" }, "Every measured trial is simulated again with the estimate. Dashed with dots: seen in the real world; solid: simulated. Looking spends no real interaction.");
  const element = h("section", { class: "card stack", hidden: true, "aria-label": "Worst trials" }, h("h2", {}, "Worst trials: real over simulated"), about, h("div", { class: "row" }, button, words), bar, tiles, large);
  let [now, done, busy]: [Standing | null, string, boolean] = [null, "", false];
  const compare = async (of: Standing): Promise<void> => {
    const with_ = physics(known(of));
    const trials = await newest(of, context.signal);
    const found: Compared[] = [];
    [bar.hidden, bar.max] = [false, trials.length];
    for (const [i, trial] of trials.entries()) {
      bar.value = i;
      const far = apart(await simulated(trial, with_, null, context.signal), trial);
      if (far !== null) found.push({ trial, apart: far });
    }
    found.sort((a, b) => b.apart - a.apart);
    const less = trials.length < of.interactions ? `the newest ${trials.length} of ${of.interactions} trials` : `${trials.length} trials`;
    put(words, found.length ? `${less}: the median is ${short(found[found.length >> 1]!.apart, "m")} apart (root mean square over the trial).` : "Nothing can be compared.");
    const shown = found.slice(0, SHOWN);
    const made = await Promise.all(shown.map((one) => tile(one, with_, (chosen) => void look(chosen, with_), context)));
    put(tiles, ...made);
    put(large);
    if (shown[0]) await look(shown[0], with_);
  };
  const look = async ({ trial, apart: far }: Compared, with_: Physics): Promise<void> => {
    try {
      const task = await scene(trial.task, context.signal);
      const one = stage(task, `Trial ${trial.proposal} of ${trial.task}, real and simulated`, context);
      one.place(trial.action, null);
      const every = Math.max(1, Math.round(SAMPLES / (task.time_step ?? 1 / 240)));
      one.simulated(await simulated(trial, with_, every, context.signal), null);
      one.real(film(trial), null);
      put(large, h("h3", {}, `Trial ${trial.proposal}, ${trial.task}: ${short(far, "m")} apart`), one.element);
      for (const b of tiles.querySelectorAll("button")) b.setAttribute("aria-pressed", String(b.dataset.trial === String(trial.proposal)));
    } catch (e) {
      context.fail(e);
    }
  };
  const run = (): void => {
    if (!now || busy) return;
    [busy, button.disabled] = [true, true];
    context.fail(null);
    compare(now)
      .catch(context.fail)
      .finally(() => ([busy, button.disabled, bar.hidden] = [false, false, true]));
  };
  button.addEventListener("click", run);
  const show = (standing: Standing): void => {
    now = standing;
    element.hidden = known(standing).length === 0;
    // At the end by itself; before only if somebody wants to see.
    if (!element.hidden && ended(standing.job) && done !== standing.job.state) {
      done = standing.job.state;
      button.hidden = true;
      run();
    }
  };
  return { element, show };
}

async function newest(of: Standing, signal: AbortSignal): Promise<Trial[]> {
  const found: Trial[] = [];
  const path = { id: of.job.id };
  for (let cursor: string | undefined; ; ) {
    const query = { limit: 100, ...(cursor ? { cursor } : {}) };
    // Without a format, JSON.
    const page = (await ok(api.GET("/v1/jobs/{id}/trials", { params: { path, query }, signal }))) as Schema<"Trials">;
    found.push(...page.trials);
    if (found.length > MOST) found.splice(0, found.length - MOST);
    if (!page.next) return found;
    cursor = page.next;
  }
}

async function simulated(trial: Trial, with_: Physics, every: number | null, signal: AbortSignal): Promise<Film> {
  const body = { task: trial.task, action: trial.action, ...with_, stop: false, ...(every ? { observe_every: every } : {}) };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  return { t: answer.t, bodies: answer.bodies, contacts: answer.contacts };
}

async function tile(one: Compared, with_: Physics, chosen: (one: Compared) => void, context: Context): Promise<HTMLElement> {
  const { trial } = one;
  const [task, shown] = await Promise.all([scene(trial.task, context.signal), simulated(trial, with_, null, context.signal)]);
  const drawn = picture(applyAction(task, trial.action), `Trial ${trial.proposal}: ways of ${Object.keys(trial.bodies).join(", ")}`);
  const dealt = colours(task);
  for (const name of Object.keys(trial.bodies)) {
    const stroke = dealt.get(name) ?? "currentColor";
    if (shown.bodies[name]) drawn.over.append(line(pathUntil(shown, name, Infinity), { class: "trail", stroke }));
    drawn.over.append(line(places(trial, name).map((p) => p.at), { class: "trail real", stroke }));
  }
  const button = h("button", { type: "button", class: "tile", "data-trial": trial.proposal, "aria-pressed": false }, h("span", { class: "thumb", "aria-hidden": "true" }, drawn.svg), h("span", {}, `${trial.proposal}: ${trial.task}, round ${trial.round + 1}`), h("strong", {}, `${short(one.apart, "m")} apart`));
  button.addEventListener("click", () => chosen(one));
  return h("li", {}, button);
}
