// The result of a diagnosis: verdict first, evidence below. Built section by section, to keep the page responsive.

import { api, all, ok, type Schema } from "../../api/client";
import { h, put } from "../../dom";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { type Context, link } from "../../view";
import { residualField, missingAccelerationField } from "./forceFields";
import { nextExperiment } from "./nextExperiment";
import { trajectories } from "./trajectories";
import { bounces, correlation, predictivePlot, residuals, parameterPlots } from "./plots";
import { trialsByDistance, sceneOfTrial, plainReport, type Report } from "./report";
import { openInPlay } from "./openInPlay";
import { effectsTable, factsList, gainsTable, latentsTable, setsTable, credibleSetList } from "./tables";
import { predictiveCheckText, digits, interval, plain, sentence, effectSetName, symbol, verdictText, VERDICT_LABELS } from "./messages";

/** Displays a result in the container. */
export async function showResult(place: HTMLElement, report: Report, job: Schema<"JobOut">, context: Context): Promise<void> {
  const { signal } = context;
  const scene = report.extended_scene ?? { format: "iplw.scene/1" as const, bodies: [] };
  const body = h("div", { class: "stack" });
  put(place, body);
  body.append(head(report, job, context));
  const sections: [string, () => (HTMLElement | null)[]][] = [
    ["Effects", () => [effectsTable(report)]],
    ["Credible set", () => [credibleSetList(report)]],
    ["Next experiment", () => nextExperiment(report, context)],
    ["Trajectories before and after", () => trajectories(report, scene, signal)],
    ["Missing and residual acceleration", () => [missingAccelerationField(report, scene), ...residualField(report, scene)]],
    ["Estimates by trial", () => parameterPlots(report, signal)],
    ["Rivals", () => [setsTable(report)]],
    ["Gain", () => [gainsTable(report)]],
    ["Latents", () => [latentsTable(report)]],
    ["Residuals before and after", () => residuals(report, signal)],
    ["Contacts", () => bounces(report, signal)],
    ["Predictive check", () => (report.predictive ? [h("p", {}, predictiveCheckText(report.predictive)), predictivePlot(report.predictive, signal)] : [])],
    ["Figures", () => [factsList(report), ...correlation(report, signal)]],
  ];
  for (const [title, make] of sections) {
    await yieldToBrowser();
    if (signal.aborted) return;
    const content = make().filter((e) => e !== null);
    if (content.length) body.append(h("section", { class: "card stack", "aria-label": title }, h("h2", {}, title), ...content));
  }
  body.dataset.whole = "true";
}

/** The verdict in words, equations, and actions. */
function head(report: Report, job: Schema<"JobOut">, context: Context): HTMLElement {
  const equations = h("div", { class: "stack equations" });
  showEffects(report, equations, context).catch(context.fail);
  const config = job.config as { scene?: string; trials?: number; job?: string | null };
  const about = [config.scene || "a scene", config.trials === undefined ? "" : `${config.trials} trials`, config.job ? `of ${config.job}` : "", `seed ${report.seed}`];
  return h(
    "section",
    { class: "card stack verdict", "aria-label": "Verdict", "data-verdict": report.verdict },
    h("div", { class: "row between" }, h("span", { class: `badge ${report.verdict}` }, VERDICT_LABELS[report.verdict]), h("span", { class: "soft" }, about.filter(Boolean).join(", "))),
    h("h2", {}, sentence(verdictText(report))),
    equations,
    h("p", {}, plain(report.reason)),
    report.residual_law
      ? h("div", {}, h("p", {}, report.residual_law.offered ? "Residual acceleration as an empirical formula; it is part of the extended scene:" : "Residual acceleration as an empirical formula; it does not improve predictions of held-out trials:"), h("pre", { tabindex: 0, "aria-label": "Formula of the residual acceleration" }, report.residual_law.formula))
      : null,
    actions(report, job),
  );
}

/** Effects with their equations and estimates. */
async function showEffects(report: Report, place: HTMLElement, { signal }: Context): Promise<void> {
  const lines = (library: readonly Schema<"EffectOut">[]): HTMLElement[] =>
    report.effects.map((e) => {
      const equation = library.find((known) => known.name === e.name)?.equation;
      // With many settings, see the table.
      const values = e.parameters.length <= 3 ? e.parameters.map((p) => `${p.name}${p.setting === null ? "" : ` of ${p.setting}`} = ${digits(p.value)} ${symbol(p.unit)} (95 %: ${interval(p.ci95)})`) : [];
      return h("p", {}, h("strong", {}, effectSetName([e.name])), equation ? [": ", equation].join("") : null, values.length ? h("span", { class: "sizes" }, values.join("; ")) : null);
    });
  put(place, ...lines([]));
  if (!report.effects.length) return;
  const library = await all((cursor) => ok(api.GET("/v1/effects", { params: { query: cursor ? { cursor } : {} }, signal })), (page) => page.effects);
  put(place, ...lines(library));
}

function actions(report: Report, job: Schema<"JobOut">): HTMLElement {
  const button = (text: string, act: () => void, main = false): HTMLElement => {
    const element = h("button", { type: "button", class: main ? "main" : null }, text);
    element.addEventListener("click", act);
    return element;
  };
  const scene = report.extended_scene;
  const order = trialsByDistance(report);
  const start = sceneOfTrial(report, order[order.length >> 1] ?? 0) ?? scene;
  return h(
    "div",
    { class: "row" },
    scene && start ? button("Play in the extended world", () => openInPlay(start, report), true) : null,
    scene ? button("Download the extended scene", () => save("extended_scene.json", scene)) : null,
    button("Download report.json", () => save("report.json", plainReport(report))),
    h("a", { href: link("diagnose") }, "Another diagnosis"),
    h("a", { href: link("jobs", [job.id]) }, "The job"),
  );
}

function save(name: string, what: unknown): void {
  const url = URL.createObjectURL(new Blob([`${JSON.stringify(what, null, 2)}\n`], { type: "application/json" }));
  h("a", { href: url, download: name }).click();
  URL.revokeObjectURL(url);
}
