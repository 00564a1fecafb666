// The form of the scene's effects beyond gravity and contact, from the server's library.

import { uniqueId, h, put } from "../../dom";
import { group, number } from "./formFields";
import type { FormContext, Library, Panel } from "./panel";
import { read, write } from "./path";

/** An effect of a scene, as in the scene format. */
interface EffectTerm {
  name: string;
  parameters?: Record<string, number>;
}

export function effectsPanel(desk: FormContext, library: Library): Panel {
  const terms = (read(desk.scene(), "effects") as EffectTerm[] | undefined) ?? [];
  const rows = terms.map((term, i) => row(desk, library, term, i));
  const element = h("div", { class: "stack" }, ...rows.map((r) => r.element), addForm(desk, library));
  return { element, fields: rows.flatMap((r) => r.fields) };
}

function row(desk: FormContext, library: Library, term: EffectTerm, index: number): Panel {
  const path = `effects[${index}]`;
  const effect = library.find((e) => e.name === term.name);
  const title = term.name.replaceAll("_", " ");
  const fields = (effect?.parameters ?? []).map((p) =>
    number(desk, { label: p.name, path: `${path}.parameters.${p.name}`, unit: p.unit === "1" ? "" : p.unit.replaceAll("^2", "²"), empty: String(p.neutral), of: `of ${title}` }),
  );
  const removeButton = h("button", { type: "button", class: "quiet", "aria-label": `Remove ${title}` }, "×");
  removeButton.addEventListener("click", () => {
    const remaining = write(desk.scene(), path, undefined);
    desk.change((remaining.effects as EffectTerm[]).length ? remaining : write(remaining, "effects", undefined), null);
  });
  const fieldset = group(title, h("div", { class: "equation" }, h("p", { class: "soft" }, effect?.equation ?? "Not in the server's library."), removeButton), ...fields);
  fieldset.classList.add("effect");
  return { element: fieldset, fields };
}

function addForm(desk: FormContext, library: Library): HTMLElement {
  const id = uniqueId("effect");
  const select = h("select", { id }, ...library.map((e) => h("option", { value: e.name }, e.name.replaceAll("_", " "))));
  const equation = h("p", { class: "soft" });
  const about = (): void => void put(equation, library.find((e) => e.name === select.value)?.equation);
  select.addEventListener("change", about);
  about();
  const add = h("button", { type: "button" }, "Add effect");
  add.addEventListener("click", () => {
    const terms = (read(desk.scene(), "effects") as EffectTerm[] | undefined) ?? [];
    const effect = library.find((e) => e.name === select.value);
    const neutral = Object.fromEntries((effect?.parameters ?? []).map((p) => [p.name, p.neutral]));
    desk.change(write(desk.scene(), "effects", [...terms, { name: select.value, parameters: neutral }]), null);
  });
  return h("div", { class: "stack" }, h("div", { class: "row" }, h("label", { for: id }, "Effect"), select, add), equation);
}
