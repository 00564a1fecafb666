// Form fields with a help text and the name of their value in the request, at which the server's errors are displayed.

import { describeError, ProblemError } from "../api/problem";
import { type Child, h, put, set, uniqueId } from "../dom";

type Input = HTMLInputElement | HTMLSelectElement;

export interface RequestField<E extends Input = Input> {
  element: HTMLElement;
  input: E;
  /** Name in the request: `latents.friction`. */
  name: string;
  /** Displays an error; `null` removes it. */
  showError: (text: string | null) => void;
}

export interface FieldText {
  /** A sentence on the meaning of the value, and which one to choose. */
  help: Child;
  unit?: string;
  /** The server's default, displayed while the field is empty. */
  placeholder?: string;
}

/** A number; while empty the request has the server's default. */
export function numberField(label: string, name: string, value: number | string | null, text: FieldText): RequestField<HTMLInputElement> {
  const input = h("input", { type: "number", step: "any", value: value ?? "", placeholder: text.placeholder });
  return field(label, name, input, text);
}

/** Makes number fields with the values that an address has. */
export function numberFields(query: URLSearchParams): (label: string, name: string, placeholder: string, help: string) => RequestField<HTMLInputElement> {
  return (label, name, placeholder, help) => numberField(label, name, query.get(name), { placeholder, help });
}

/** A line of text. */
export function textField(label: string, name: string, value: string, text: FieldText): RequestField<HTMLInputElement> {
  const input = h("input", { type: "text", value, placeholder: text.placeholder, spellcheck: "false", autocomplete: "off" });
  return field(label, name, input, text);
}

/** A choice among `[value, label]`. */
export function choiceField(label: string, name: string, options: readonly (readonly [string, string])[], value: string | null, text: FieldText): RequestField<HTMLSelectElement> {
  const input = h("select", {}, ...options.map(([v, words]) => h("option", { value: v, selected: v === value }, words)));
  return field(label, name, input, text);
}

/** A check box with its label beside it. */
export function checkField(label: string, name: string, checked: boolean, text: FieldText): RequestField<HTMLInputElement> {
  const input = h("input", { type: "checkbox", checked });
  const built = field(label, name, input, text);
  built.element.classList.add("check");
  return built;
}

function field<E extends Input>(label: string, name: string, input: E, { help, unit }: FieldText): RequestField<E> {
  const [id, helpId, errorId] = [uniqueId("field"), uniqueId("help"), uniqueId("error")];
  const error = h("span", { id: errorId, class: "field-error", role: "alert" });
  set(input, { id, "data-field": name, "aria-describedby": `${helpId} ${errorId}` });
  const row = unit ? h("span", { class: "field-row" }, input, h("span", { class: "soft" }, unit)) : input;
  const element = h("div", { class: "request-field" }, h("label", { for: id }, label), row, h("span", { id: helpId, class: "help" }, help), error);
  const showError = (text: string | null): void => {
    set(input, { "aria-invalid": text === null ? null : "true" });
    put(error, text);
  };
  input.addEventListener("input", () => showError(null));
  return { element, input, name, showError };
}

/** The number in a field; `undefined` while empty. */
export function numberOf(field: RequestField): number | undefined {
  return field.input.value.trim() === "" ? undefined : Number(field.input.value);
}

/** The numbers of fields by the fields' names, without empty ones. */
export function numbersOf(fields: readonly RequestField[]): Record<string, number> {
  return Object.fromEntries(fields.flatMap((field) => (numberOf(field) === undefined ? [] : [[field.name, numberOf(field)!]])));
}

/** The first field whose text is not a number gets an error; `false` if there is none. */
export function showInvalidNumber(fields: readonly RequestField[]): boolean {
  const invalid = fields.find((f) => f.input.validity.badInput);
  if (invalid) showAt(invalid, "This is not a number.");
  return invalid !== undefined;
}

/** Displays an error at the visible field that it names; `false` if it names none of these. */
export function showFieldError(fields: readonly RequestField[], error: unknown): boolean {
  const { detail, field: name } = describeError(error);
  const visible = fields.filter((f) => !f.element.closest("[hidden]"));
  const match = visible.find((f) => f.name === name) ?? visible.find((f) => name?.startsWith(`${f.name}.`)) ?? visible.find((f) => name === null && isAboutValue(error, f.input.value));
  if (match) showAt(match, detail);
  return match !== undefined;
}

/** Whether an error that names no field concerns a value: a task that does not exist. */
function isAboutValue(error: unknown, value: string): boolean {
  return error instanceof ProblemError && value !== "" && error.problem.detail.includes(`\`${value}\``);
}

function showAt(field: RequestField, text: string): void {
  const fold = field.element.closest("details");
  if (fold) fold.open = true;
  field.showError(text);
  field.input.focus();
}
