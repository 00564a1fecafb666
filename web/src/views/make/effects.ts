// The form of the effects that the scene has beyond gravity and contact: from the server's library, with their parameters.

import type { Schema } from "../../api/client";
import { uniqueId, h, put } from "../../dom";
import { group, number } from "./form";
import type { Desk, Panel } from "./panels";
import { read, write } from "./path";

/** An effect of a scene, as the format has it. */
interface Term {
  name: string;
  parameters?: Record<string, number>;
}

export type Library = readonly Schema<"EffectOut">[];

export function effectsPanel(desk: Desk, library: Library): Panel {
  const terms = (read(desk.scene(), "effects") as Term[] | undefined) ?? [];
  const rows = terms.map((term, i) => row(desk, library, term, i));
  const element = h("div", { class: "stack" }, ...rows.map((r) => r.element), adding(desk, library));
  return { element, fields: rows.flatMap((r) => r.fields) };
}

function row(desk: Desk, library: Library, term: Term, index: number): Panel {
  const path = `effects[${index}]`;
  const known = library.find((e) => e.name === term.name);
  const title = term.name.replaceAll("_", " ");
  const fields = (known?.parameters ?? []).map((p) =>
    number(desk, { label: p.name, path: `${path}.parameters.${p.name}`, unit: p.unit === "1" ? "" : p.unit.replaceAll("^2", "²"), empty: String(p.neutral), of: `of ${title}` }),
  );
  const gone = h("button", { type: "button", class: "quiet", "aria-label": `Remove ${title}` }, "×");
  gone.addEventListener("click", () => {
    const left = write(desk.scene(), path, undefined);
    desk.change((left.effects as Term[]).length ? left : write(left, "effects", undefined), null);
  });
  const made = group(title, h("div", { class: "equation" }, h("p", { class: "soft" }, known?.equation ?? "The server's library does not have it."), gone), ...fields);
  made.classList.add("effect");
  return { element: made, fields };
}

function adding(desk: Desk, library: Library): HTMLElement {
  const id = uniqueId("effect");
  const chosen = h("select", { id }, ...library.map((e) => h("option", { value: e.name }, e.name.replaceAll("_", " "))));
  const equation = h("p", { class: "soft" });
  const about = (): void => void put(equation, library.find((e) => e.name === chosen.value)?.equation);
  chosen.addEventListener("change", about);
  about();
  const add = h("button", { type: "button" }, "Add the effect");
  add.addEventListener("click", () => {
    const terms = (read(desk.scene(), "effects") as Term[] | undefined) ?? [];
    const effect = library.find((e) => e.name === chosen.value);
    const neutral = Object.fromEntries((effect?.parameters ?? []).map((p) => [p.name, p.neutral]));
    desk.change(write(desk.scene(), "effects", [...terms, { name: chosen.value, parameters: neutral }]), null);
  });
  return h("div", { class: "stack" }, h("div", { class: "row" }, h("label", { for: id }, "Effect"), chosen, add), equation);
}
