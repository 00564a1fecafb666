// Fields of forms, and the server's errors at the field that they name.

import { describeError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";

export interface FormField {
  element: HTMLElement;
  /** Shows an error at it, or takes it away. */
  showError: (errorText: string | null) => void;
}

/** An input with its label, a hint, and a place for what is wrong with it. */
export function field(label: string, input: HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement, hint: string | HTMLElement | null = null): FormField {
  const [id, about, errorId] = [input.id || uniqueId("field"), uniqueId("hint"), uniqueId("wrong")];
  const errorText = h("p", { id: errorId, class: "why", hidden: true });
  set(input, { id, "aria-describedby": hint ? `${about} ${errorId}` : errorId });
  const showError = (text: string | null): void => {
    errorText.hidden = text === null;
    put(errorText, text);
    set(input, { "aria-invalid": text === null ? null : "true" });
    if (text !== null) input.focus();
  };
  const element = h("div", { class: "field" }, h("label", { for: id }, label), input, hint ? h("span", { class: "soft hint", id: about }, hint) : null, errorText);
  return { element, showError: showError };
}

/** Puts an error at the field that it names, or at the one that holds it; `false` if there is none. */
export function showFieldError(error: unknown, fields: ReadonlyMap<string, FormField>): boolean {
  for (const f of fields.values()) f.showError(null);
  if (error === null) return true;
  const { detail, field: fieldName } = describeError(error);
  for (let name = fieldName ?? ""; name; name = name.replace(/[.[]?[^.[]*$/, "")) {
    const match = fields.get(name);
    if (match) return match.showError(detail), true;
  }
  return false;
}
