// Form fields that display the server's errors.

import { describeError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";

export interface FormField {
  element: HTMLElement;
  /** Displays an error at the field; `null` removes it. */
  showError: (errorText: string | null) => void;
}

/** An input with a label, a hint and an error message. */
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

/** Displays an error at the field that it names, or at the closest enclosing one; `false` if there is none. */
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
