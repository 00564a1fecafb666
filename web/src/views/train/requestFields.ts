// Fields of a form that know what the server calls them, so that a refusal is told where it belongs.

import type { Schema } from "../../api/client";
import { describeError } from "../../api/problem";
import { type Child, uniqueId, h, put, set } from "../../dom";

export interface RequestField<E extends HTMLInputElement | HTMLSelectElement = HTMLInputElement> {
  element: HTMLElement;
  input: E;
  /** As the server names it: `latents.friction`. */
  name: string;
  /** Says what is wrong with it; `null` that nothing is. */
  showError: (errorText: string | null) => void;
}

/** A number; an empty one is left to the server. */
export function number(label: string, name: string, options: { value?: number; hint?: string } = {}): RequestField {
  // Not limited here: what is allowed, the server says.
  const input = h("input", { type: "number", step: "any", value: options.value ?? "" });
  return field(label, name, input, options.hint);
}

/** A choice among `[value, words]`. */
export function choice(label: string, name: string, options: readonly (readonly [string, string])[], hint?: string): RequestField<HTMLSelectElement> {
  const select = h("select", {}, ...options.map(([value, words]) => h("option", { value }, words)));
  return field(label, name, select, hint);
}

function field<E extends HTMLInputElement | HTMLSelectElement>(label: string, name: string, input: E, hint?: string): RequestField<E> {
  const [id, errorId] = [uniqueId("field"), uniqueId("why")];
  const errorText = h("span", { id: errorId, class: "why", role: "alert" });
  const about: Child = hint ? h("span", { class: "soft" }, hint) : null;
  set(input, { id, "data-field": name, "aria-describedby": errorId });
  const element = h("div", { class: "asks" }, h("label", { for: id }, label), input, about, errorText);
  const showError = (text: string | null): void => {
    set(input, { "aria-invalid": text === null ? null : "true" });
    put(errorText, text);
  };
  input.addEventListener("input", () => showError(null));
  return { element, input, name, showError: showError };
}

/** The number that stands in a field; `undefined` if none does. */
export function numberOf(field: RequestField): number | undefined {
  return field.input.value === "" ? undefined : Number(field.input.value);
}

/** Tells a refusal at the field that it names and goes there; `false` if it names none of these. */
export function showFieldError(fields: readonly RequestField<HTMLInputElement | HTMLSelectElement>[], error: unknown): boolean {
  const { detail, field: name } = describeError(error);
  const match = fields.find((f) => f.name === name && !f.element.hidden && !f.element.closest("[hidden]"));
  if (!match) return false;
  match.showError(detail);
  match.input.focus();
  return true;
}

/** A world with its kind, where its name does not tell. */
export function worldLabel(world: Schema<"WorldOut">): string {
  return world.id.includes(world.kind) ? world.id : `${world.id}, ${world.kind}`;
}
