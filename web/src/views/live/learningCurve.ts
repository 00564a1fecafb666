// Success and return over the episodes of a world.

import { h, put } from "../../dom";
import { curvePlot } from "../../parts/curvePlot";
import { type Episode, successShares, WINDOW } from "./episodes";

/** Points drawn at most; of more episodes the last. */
const MAX_POINTS = 500;

export interface LearningCurve {
  element: HTMLElement;
  show: (episodes: readonly Episode[]) => void;
}

export function learningCurve(): LearningCurve {
  const plot = curvePlot({ about: "Success and return by episode", x: "episode", y: "share, return", most: 1, marked: true });
  const figures = h("p", { class: "row live-figures" });
  const none = h("p", { class: "soft" }, "The curve begins with the next episode that ends: it counts from the moment this page is opened.");
  const legend = h("p", { class: "row small" }, h("span", {}, h("span", { class: "run-key share" }), `share solved of the last ${WINDOW} episodes`), h("span", {}, h("span", { class: "dot-key" }), "return of an episode"));
  const chart = h("div", { class: "chart" }, legend, plot.svg);
  const element = h("section", { class: "card stack live-curve", "aria-label": "Success and return" }, h("h2", {}, "Success and return"), none, figures, chart);
  const show = (episodes: readonly Episode[]): void => {
    [none.hidden, chart.hidden, figures.hidden] = [episodes.length > 0, !episodes.length, !episodes.length];
    const last = episodes.at(-1);
    if (!last) return;
    const shares = successShares(episodes).slice(-MAX_POINTS);
    const part = episodes.slice(-MAX_POINTS);
    const x = part.map((e) => e.number);
    plot.draw([{ name: "return", look: 2, x, y: part.map((e) => e.return) }, { name: "success", look: 1, x, y: shares }], WINDOW);
    const recent = episodes.slice(-WINDOW);
    const solved = recent.filter((e) => e.solved).length;
    put(figures, figure(String(last.number), "episodes"), figure(`${Math.round((100 * solved) / recent.length)} %`, `of the last ${recent.length} solved`), figure(last.return.toFixed(2), "last return"));
  };
  show([]);
  return { element, show };
}

function figure(value: string, text: string): HTMLElement {
  return h("span", { class: "figure" }, h("strong", {}, value), " ", h("span", { class: "soft small" }, text));
}
