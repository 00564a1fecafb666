// Form fields with their name in the request, so that errors are displayed at the field.

import type { Schema } from "../../api/client";
import { describeError } from "../../api/problem";
import { type Child, uniqueId, h, put, set } from "../../dom";

export interface RequestField<E extends HTMLInputElement | HTMLSelectElement = HTMLInputElement> {
  element: HTMLElement;
  input: E;
  /** Name in the request: `latents.friction`. */
  name: string;
  /** Displays an error; `null` removes it. */
  showError: (errorText: string | null) => void;
}

/** A number; an empty field uses the server's default. */
export function number(label: string, name: string, options: { value?: number; hint?: string } = {}): RequestField {
  // No limits here: the server validates.
  const input = h("input", { type: "number", step: "any", value: options.value ?? "" });
  return field(label, name, input, options.hint);
}

/** A choice among `[value, label]`. */
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

/** The number in a field; `undefined` if empty. */
export function numberOf(field: RequestField): number | undefined {
  return field.input.value === "" ? undefined : Number(field.input.value);
}

/** Displays an error at the field that it names and focuses it; `false` if it names none of these. */
export function showFieldError(fields: readonly RequestField<HTMLInputElement | HTMLSelectElement>[], error: unknown): boolean {
  const { detail, field: name } = describeError(error);
  const match = fields.find((f) => f.name === name && !f.element.hidden && !f.element.closest("[hidden]"));
  if (!match) return false;
  match.showError(detail);
  match.input.focus();
  return true;
}

/** A world's id, with its kind unless the id contains it. */
export function worldLabel(world: Schema<"WorldOut">): string {
  return world.id.includes(world.kind) ? world.id : `${world.id}, ${world.kind}`;
}
