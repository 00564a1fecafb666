// A list of effects of the library to add to a request.

import type { Schema } from "../../api/client";
import { h, put, uniqueId } from "../../dom";

export interface EffectList {
  element: HTMLElement;
  /** The names of the effects, each in a set of its own. */
  value: () => string[][];
  names: () => string[];
}

/** Effects from the library as removable items; `initial`: names separated by commas. */
export function effectSets(library: readonly Schema<"EffectOut">[], initial: string | null, name: string, help: string, label = "Possible effects"): EffectList {
  const names = new Set((initial ?? "").split(",").filter((n) => library.some((e) => e.name === n)));
  const [id, helpId] = [uniqueId("effects"), uniqueId("help")];
  const list = h("ul", { class: "chips" });
  const placeholder = h("option", { value: "" }, "add an effect…");
  const select = h("select", { id, "data-field": name, "aria-describedby": helpId }, placeholder, ...library.map((e) => h("option", { value: e.name, title: e.equation }, title(e.name))));
  const show = (): void => void put(list, ...[...names].map(chip));
  const chip = (effect: string): HTMLElement => {
    const remove = h("button", { type: "button", "aria-label": `Remove ${title(effect)}` }, "×");
    remove.addEventListener("click", () => {
      names.delete(effect);
      show();
      select.focus();
    });
    return h("li", {}, title(effect), remove);
  };
  select.addEventListener("change", () => {
    if (select.value) names.add(select.value);
    select.value = "";
    show();
  });
  show();
  const element = h("div", { class: "request-field" }, h("label", { for: id }, label), list, select, h("span", { id: helpId, class: "help" }, help));
  return { element, value: () => [...names].map((n) => [n]), names: () => [...names] };
}

function title(name: string): string {
  return name.replaceAll("_", " ");
}
