// Fields of forms, and the server's errors at the field that they name.

import { describeError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";

export interface Field {
  element: HTMLElement;
  /** Shows an error at it, or takes it away. */
  refuse: (why: string | null) => void;
}

/** An input with its label, a hint, and a place for what is wrong with it. */
export function field(label: string, input: HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement, hint: string | HTMLElement | null = null): Field {
  const [id, about, wrong] = [input.id || uniqueId("field"), uniqueId("hint"), uniqueId("wrong")];
  const why = h("p", { id: wrong, class: "why", hidden: true });
  set(input, { id, "aria-describedby": hint ? `${about} ${wrong}` : wrong });
  const refuse = (text: string | null): void => {
    why.hidden = text === null;
    put(why, text);
    set(input, { "aria-invalid": text === null ? null : "true" });
    if (text !== null) input.focus();
  };
  const element = h("div", { class: "field" }, h("label", { for: id }, label), input, hint ? h("span", { class: "soft hint", id: about }, hint) : null, why);
  return { element, refuse };
}

/** Puts an error at the field that it names, or at the one that holds it; `false` if there is none. */
export function refused(error: unknown, fields: ReadonlyMap<string, Field>): boolean {
  for (const f of fields.values()) f.refuse(null);
  if (error === null) return true;
  const { detail, field: named } = describeError(error);
  for (let name = named ?? ""; name; name = name.replace(/[.[]?[^.[]*$/, "")) {
    const found = fields.get(name);
    if (found) return found.refuse(detail), true;
  }
  return false;
}
