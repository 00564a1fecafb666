// The jobs selected for a comparison, across pages.

import { h, put } from "../../dom";
import { link } from "../../view";

export interface Selection {
  element: HTMLElement;
  has: (id: string) => boolean;
  toggle: (id: string, on: boolean) => void;
}

/** `first`: a job that is selected already. */
export function selection(first: string | null): Selection {
  const ids = new Set(first ? [first] : []);
  const button = h("button", { type: "button", class: "main" }, "Compare");
  const text = h("span", { class: "soft", role: "status" });
  button.addEventListener("click", () => (location.hash = compareAddress([...ids])));
  const show = (): void => {
    button.disabled = ids.size !== 2;
    const list = [...ids].join(" and ");
    put(text, ids.size === 0 ? "Select two jobs to compare them." : ids.size === 1 ? `${list} is selected: select one more.` : ids.size === 2 ? `${list} are selected.` : `${ids.size} are selected: two can be compared.`);
  };
  show();
  const toggle = (id: string, on: boolean): void => {
    if (on) ids.add(id);
    else ids.delete(id);
    show();
  };
  return { element: h("div", { class: "row" }, button, text), has: (id) => ids.has(id), toggle };
}

/** Address of a comparison: `#/jobs?compare=job-1,job-2`. */
export function compareAddress(ids: readonly string[]): string {
  return link("jobs", [], { compare: ids.join(",") }).replaceAll("%2C", ",");
}
