// What a diagnosis found: the verdict first, what it rests on below. Built a section at a time, so that the page stays quick.

import { api, all, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { type Context, link } from "../../view";
import { fieldLeft, fieldMissing } from "./fields";
import { next } from "./next";
import { paths } from "./paths";
import { bounces, correlation, predictive, residuals, sizes } from "./plots";
import { byDistance, launched, plainReport, type Report } from "./report";
import { play } from "./play";
import { effects, facts, gains, latents, rivals, ties } from "./tables";
import { checked, digits, interval, plain, sentence, set, symbol, verdict, VERDICTS } from "./words";

/** Shows a result in place of what was there. */
export async function result(place: HTMLElement, found: Report, job: Schema<"JobOut">, context: Context): Promise<void> {
  const { signal } = context;
  const scene = found.extended_scene ?? { format: "iplw.scene/1" as const, bodies: [] };
  const body = h("div", { class: "stack" });
  put(place, body);
  body.append(head(found, job, context));
  const sections: [string, () => (HTMLElement | null)[]][] = [
    ["Effects", () => [effects(found)]],
    ["Sets that tie", () => [ties(found)]],
    ["Next experiment", () => next(found, context)],
    ["Paths before and after", () => paths(found, scene, signal)],
    ["What is missing, and what is left", () => [fieldMissing(found, scene), ...fieldLeft(found, scene)]],
    ["Sizes launch by launch", () => sizes(found, signal)],
    ["Rivals", () => [rivals(found)]],
    ["Gain", () => [gains(found)]],
    ["Latents", () => [latents(found)]],
    ["Residuals before and after", () => residuals(found, signal)],
    ["What contacts gave", () => bounces(found, signal)],
    ["Predictive check", () => (found.predictive ? [h("p", {}, checked(found.predictive)), predictive(found.predictive, signal)] : [])],
    ["Figures", () => [facts(found), ...correlation(found, signal)]],
  ];
  for (const [title, make] of sections) {
    await yieldToBrowser();
    if (signal.aborted) return;
    const content = make().filter((e) => e !== null);
    if (content.length) body.append(h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content));
  }
  body.dataset.whole = "true";
}

/** The verdict in words, what it is in symbols, and what can be done with it. */
function head(found: Report, job: Schema<"JobOut">, context: Context): HTMLElement {
  const equations = h("div", { class: "stack equations" });
  named(found, equations, context).catch(context.fail);
  const config = job.config as { scene?: string; trials?: number; job?: string | null };
  const about = [config.scene || "a scene", config.trials === undefined ? "" : `${config.trials} trials`, config.job ? `of ${config.job}` : "", `seed ${found.seed}`];
  return h(
    "section",
    { class: "card stack verdict", "aria-label": "Verdict", "data-verdict": found.verdict },
    h("div", { class: "row between" }, h("span", { class: `badge ${found.verdict}` }, VERDICTS[found.verdict]), h("span", { class: "soft" }, about.filter(Boolean).join(", "))),
    h("h2", {}, sentence(verdict(found))),
    equations,
    h("p", {}, plain(found.reason)),
    found.residual_law
      ? h("div", {}, h("p", {}, found.residual_law.offered ? "What is left, as an acceleration without a name; it is part of the extended scene:" : "What is left, as an acceleration without a name; on held-out trials it does not help:"), h("pre", { tabindex: 0, "aria-label": "Formula of what is left" }, found.residual_law.formula))
      : null,
    actions(found, job),
  );
}

/** Found effects with their equations and sizes. */
async function named(found: Report, place: HTMLElement, { signal }: Context): Promise<void> {
  const lines = (library: readonly Schema<"EffectOut">[]): HTMLElement[] =>
    found.effects.map((e) => {
      const equation = library.find((known) => known.name === e.name)?.equation;
      // Of many settings the table has the sizes.
      const few = e.parameters.length <= 3 ? e.parameters.map((p) => `${p.name}${p.setting === null ? "" : ` of ${p.setting}`} = ${digits(p.value)} ${symbol(p.unit)} (95 %: ${interval(p.ci95)})`) : [];
      return h("p", {}, h("strong", {}, set([e.name])), equation ? [": ", equation].join("") : null, few.length ? h("span", { class: "sizes" }, few.join("; ")) : null);
    });
  put(place, ...lines([]));
  if (!found.effects.length) return;
  const library = await all((cursor) => ok(api.GET("/v1/effects", { params: { query: cursor ? { cursor } : {} }, signal })), (page) => page.effects);
  put(place, ...lines(library));
}

function actions(found: Report, job: Schema<"JobOut">): HTMLElement {
  const button = (text: string, act: () => void, main = false): HTMLElement => {
    const element = h("button", { type: "button", class: main ? "main" : null }, text);
    element.addEventListener("click", act);
    return element;
  };
  const scene = found.extended_scene;
  const order = byDistance(found);
  const start = launched(found, order[order.length >> 1] ?? 0) ?? scene;
  return h(
    "div",
    { class: "row" },
    scene && start ? button("Play in the extended world", () => play(start, found), true) : null,
    scene ? button("Download the extended scene", () => save("extended_scene.json", scene)) : null,
    button("Download report.json", () => save("report.json", plainReport(found))),
    h("a", { href: link("diagnose") }, "Another diagnosis"),
    h("a", { href: link("jobs", [job.id]) }, "The job"),
  );
}

function save(name: string, what: unknown): void {
  const url = URL.createObjectURL(new Blob([`${JSON.stringify(what, null, 2)}\n`], { type: "application/json" }));
  h("a", { href: url, download: name }).click();
  URL.revokeObjectURL(url);
}
