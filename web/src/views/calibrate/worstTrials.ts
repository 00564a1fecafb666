// Worst trials: real compared with simulated, as pictures, with one of them as a film.

import { api, ok, type Schema } from "../../api/client";
import { hasEnded } from "../../api/jobState";
import { h, put } from "../../dom";
import { short } from "../../parts/slider";
import { colours } from "../../scene/colour";
import { line, picture } from "../../scene/draw";
import { type Film, pathUntil } from "../../scene/film";
import { applyAction } from "../../scene/action";
import type { Context } from "../../view";
import { filmStage } from "../play/stage";
import { currentEstimates, simulationPhysics, type EstimationState } from "./estimation";
import { sceneOfTask, taskName } from "./rounds";
import { rmsDistance, filmOfTrial, observations } from "./tracks";

type Trial = Schema<"TrialOut">;
type Physics = ReturnType<typeof simulationPhysics>;

/** Maximum number of trials simulated, newest first. */
const MAX_TRIALS = 200;
/** Trials displayed. */
const TRIALS_SHOWN = 6;
/** Time between two samples of a film, s; below the frame time of a screen. */
const SAMPLE_INTERVAL_S = 1 / 60;

interface ComparedTrial {
  trial: Trial;
  /** RMS distance, m. */
  distance: number;
}

export interface WorstTrials {
  element: HTMLElement;
  show: (now: EstimationState) => void;
}

export function worstTrials(context: Context): WorstTrials {
  const button = h("button", { type: "button" }, "Compare now");
  const words = h("p", { class: "soft", role: "status" });
  const bar = h("progress", { hidden: true, "aria-label": "Simulated trials" });
  const tiles = h("ul", { class: "tiles worst" });
  const large = h("div", {});
  const about = h("p", { class: "soft" }, "Every measured trial is simulated with the estimate. Dashed with dots: measured in the real world; solid: simulated. This costs no real interaction.");
  const element = h("section", { class: "card stack", hidden: true, "aria-label": "Worst trials" }, h("h2", {}, "Worst trials: real and simulated"), about, h("div", { class: "row" }, button, words), bar, tiles, large);
  let [now, done, busy]: [EstimationState | null, string, boolean] = [null, "", false];
  const compare = async (of: EstimationState): Promise<void> => {
    const physics = simulationPhysics(currentEstimates(of));
    const trials = await newestTrials(of, context.signal);
    const compared: ComparedTrial[] = [];
    [bar.hidden, bar.max] = [false, trials.length];
    for (const [i, trial] of trials.entries()) {
      bar.value = i;
      const trialDistance = rmsDistance(await simulate(trial, physics, null, context.signal), trial);
      if (trialDistance !== null) compared.push({ trial, distance: trialDistance });
    }
    compared.sort((a, b) => b.distance - a.distance);
    const subset = trials.length < of.interactions ? `the newest ${trials.length} of ${of.interactions} trials` : `${trials.length} trials`;
    put(words, compared.length ? `${subset}: in the median trial they are ${short(compared[compared.length >> 1]!.distance, "m")} apart (RMS over the trial).` : "Nothing can be compared.");
    const worst = compared.slice(0, TRIALS_SHOWN);
    const elements = await Promise.all(worst.map((one) => tile(one, physics, (onChosen) => void showTrial(onChosen, physics), context)));
    put(tiles, ...elements);
    put(large);
    if (worst[0]) await showTrial(worst[0], physics);
  };
  const showTrial = async ({ trial, distance: trialDistance }: ComparedTrial, physics: Physics): Promise<void> => {
    try {
      const task = await sceneOfTask(trial.task, context.signal);
      const one = filmStage(task, `Trial ${trial.proposal} of ${taskName(trial.task)}, real and simulated`, context);
      one.place(trial.action, null);
      const every = Math.max(1, Math.round(SAMPLE_INTERVAL_S / (task.time_step ?? 1 / 240)));
      one.simulated(await simulate(trial, physics, every, context.signal), null);
      one.real(filmOfTrial(trial), null);
      put(large, h("h3", {}, `Trial ${trial.proposal}, ${taskName(trial.task)}: ${short(trialDistance, "m")} apart`), one.element);
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
  const show = (standing: EstimationState): void => {
    now = standing;
    element.hidden = currentEstimates(standing).length === 0;
    // Automatic at the end of the estimation; before that only on request.
    if (!element.hidden && hasEnded(standing.job) && done !== standing.job.state) {
      done = standing.job.state;
      button.hidden = true;
      run();
    }
  };
  return { element, show };
}

async function newestTrials(of: EstimationState, signal: AbortSignal): Promise<Trial[]> {
  const compared: Trial[] = [];
  const path = { id: of.job.id };
  for (let cursor: string | undefined; ; ) {
    const query = { limit: 100, ...(cursor ? { cursor } : {}) };
    // The default format is JSON.
    const page = (await ok(api.GET("/v1/jobs/{id}/trials", { params: { path, query }, signal }))) as Schema<"TrialsPage">;
    compared.push(...page.trials);
    if (compared.length > MAX_TRIALS) compared.splice(0, compared.length - MAX_TRIALS);
    if (!page.next) return compared;
    cursor = page.next;
  }
}

async function simulate(trial: Trial, physics: Physics, every: number | null, signal: AbortSignal): Promise<Film> {
  const subject = trial.task.startsWith("custom:") ? { scene: (await sceneOfTask(trial.task, signal)) as unknown as Record<string, never> } : { task: trial.task };
  const body = { ...subject, action: trial.action, ...physics, stop: false, ...(every ? { observe_every: every } : {}) };
  const answer = await ok(api.POST("/v1/simulate", { body, signal }));
  return { t: answer.t, bodies: answer.bodies, contacts: answer.contacts };
}

async function tile(one: ComparedTrial, physics: Physics, onChosen: (one: ComparedTrial) => void, context: Context): Promise<HTMLElement> {
  const { trial } = one;
  const [task, worst] = await Promise.all([sceneOfTask(trial.task, context.signal), simulate(trial, physics, null, context.signal)]);
  const drawing = picture(applyAction(task, trial.action), `Trial ${trial.proposal}: trajectories of ${Object.keys(trial.bodies).join(", ")}`);
  const bodyColours = colours(task);
  for (const name of Object.keys(trial.bodies)) {
    const stroke = bodyColours.get(name) ?? "currentColor";
    if (worst.bodies[name]) drawing.over.append(line(pathUntil(worst, name, Infinity), { class: "trail", stroke }));
    drawing.over.append(line(observations(trial, name).map((p) => p.at), { class: "trail real", stroke }));
  }
  const button = h("button", { type: "button", class: "tile", "data-trial": trial.proposal, "aria-pressed": false }, h("span", { class: "thumb", "aria-hidden": "true" }, drawing.svg), h("span", {}, `${trial.proposal}: ${taskName(trial.task)}, round ${trial.round + 1}`), h("strong", {}, `${short(one.distance, "m")} apart`));
  button.addEventListener("click", () => onChosen(one));
  return h("li", {}, button);
}
