// Form fields of a draft: each displays the value at its path, writes the input to it, and displays errors.

import { uniqueId, h, put, set } from "../../dom";
import type { Scene } from "../../scene/types";
import { affectedFields, read, write } from "./path";

/** The draft of a form. */
export interface Draft {
  scene: () => Scene;
  /** Replaces the scene; changes with the same key are undone together. */
  change: (scene: Scene, key: string | null) => void;
}

export interface Field {
  element: HTMLElement;
  /** Path as the server names it. */
  path: string;
  show: (scene: Scene) => void;
  /** Marks the field as invalid and optionally displays the message; `null` removes the mark. */
  mark: (message: string | null, showText?: boolean) => void;
}

/** Description of a field. */
export interface FieldSpec {
  label: string;
  path: string;
  unit?: string;
  /** Meaning of an empty field, displayed as a placeholder; without it the field is required. */
  empty?: string;
  /** The default of both numbers, if the path is one of a pair that the scene lacks. */
  pair?: [number, number];
  whole?: boolean;
  /** Context for screen readers, for example the corner it belongs to. */
  of?: string;
}

/** A number, in SI units. */
export function number(draft: Draft, spec: FieldSpec): Field {
  const input = h("input", { type: "number", step: "any", inputmode: "decimal", placeholder: spec.empty });
  return field(draft, spec, input, (scene) => {
    const now = read(scene, spec.path);
    // Hide rounding errors beyond nine digits; the scene keeps them.
    return typeof now === "number" ? String(Number(now.toPrecision(9))) : "";
  }, (text) => {
    const value = text === "" ? undefined : Number(text);
    if (value === undefined && spec.empty === undefined) return "Enter a number.";
    if (value !== undefined && !Number.isFinite(value)) return "This is not a number.";
    draft.change(withNumber(draft.scene(), spec, value), `type-${spec.path}`);
    return null;
  }, "input");
}

/** A text; `changed` returns the new scene, or an error message. */
export function text(draft: Draft, spec: FieldSpec, changed: (scene: Scene, value: string) => Scene | string): Field {
  const input = h("input", { type: "text", autocomplete: "off", spellcheck: "false" });
  return field(draft, spec, input, (scene) => String(read(scene, spec.path) ?? ""), (value) => {
    const next = changed(draft.scene(), value);
    if (typeof next === "string") return next;
    draft.change(next, `type-${spec.path}`);
    return null;
  }, "input");
}

/** A choice; `of` returns the current value, `changed` the scene with another one. */
export function choice(
  draft: Draft,
  spec: FieldSpec,
  options: readonly [string, string][],
  of: (scene: Scene) => string,
  changed: (scene: Scene, value: string) => Scene,
): Field {
  const input = h("select", {}, ...options.map(([value, title]) => h("option", { value }, title)));
  const show = (scene: Scene): string => {
    const now = of(scene);
    // Display a name that no object has; the server reports it.
    if (![...input.options].some((o) => o.value === now)) input.append(h("option", { value: now }, now || "none"));
    return now;
  };
  return field(draft, spec, input, show, (value) => {
    draft.change(changed(draft.scene(), value), null);
    return null;
  }, "change");
}

/** A choice among names at a path. */
export function nameChoice(draft: Draft, spec: FieldSpec, names: readonly string[]): Field {
  const options = names.map((n): [string, string] => [n, n]);
  return choice(draft, spec, options, (scene) => String(read(scene, spec.path) ?? ""), (scene, value) => write(scene, spec.path, value));
}

/** A row of fields with a title. */
export function group(title: string, ...parts: (Field | HTMLElement)[]): HTMLElement {
  return h("fieldset", { class: "fields" }, h("legend", {}, title), ...parts.map((p) => ("path" in p ? p.element : p)));
}

/** Marks the fields that a problem concerns and returns them. */
export function markFields(fields: readonly Field[], problem: { field: string; message: string } | null): Field[] {
  const paths = problem ? affectedFields(fields.map((f) => f.path), problem.field) : [];
  const invalid = fields.filter((f) => paths.includes(f.path));
  // The message is displayed once, at the first field.
  for (const f of fields) f.mark(invalid.includes(f) ? problem!.message : null, f === invalid[0]);
  return invalid;
}

/** The scene with a number at a path; if it is one of a missing pair, the other number gets its default. */
export function withNumber(scene: Scene, { path, pair, empty }: FieldSpec, value: number | undefined): Scene {
  const [, parent, index] = /^(.*)\[(\d)\]$/.exec(path) ?? [];
  if (!pair || parent === undefined) return write(scene, path, value);
  const now = (read(scene, parent) as [number, number] | null | undefined) ?? pair;
  // One number of a pair cannot be removed.
  if (value === undefined) return empty === undefined ? scene : write(scene, parent, undefined);
  return write(scene, parent, index === "0" ? [value, now[1]] : [now[0], value]);
}

function field(
  draft: Draft,
  spec: FieldSpec,
  input: HTMLInputElement | HTMLSelectElement,
  of: (scene: Scene) => string,
  onInput: (text: string) => string | null,
  event: "input" | "change",
): Field {
  const [id, whyId] = [uniqueId("field"), uniqueId("why")];
  const message = h("p", { class: "why", id: whyId });
  const context = spec.of ? h("span", { class: "unseen" }, ` ${spec.of}`) : null;
  const title = h("label", { for: id }, spec.label, context, spec.unit ? h("span", { class: "soft" }, ` ${spec.unit}`) : null);
  set(input, { id, "data-field": spec.path });
  const element = h("div", { class: "field" }, title, input);
  const mark = (text: string | null, showText = true): void => {
    const words = showText ? text : null;
    set(input, { "aria-invalid": text === null ? null : "true", "aria-describedby": words === null ? null : whyId });
    put(message, words);
    if (words === null) return message.remove();
    // Span all columns, if any.
    const row = element.closest(".fields, .corner") ?? element;
    if (message.parentElement !== row) row.append(message);
  };
  let [hasLocalError, hasUnusedInput] = [false, false];
  input.addEventListener(event, () => {
    // An incomplete number ("-") is not yet an error.
    const invalid = input.validity.badInput ? null : onInput(input.value);
    hasLocalError = invalid !== null;
    hasUnusedInput = hasLocalError || input.validity.badInput;
    if (hasLocalError) mark(invalid);
  });
  const show = (scene: Scene): void => {
    if (document.activeElement === input && event === "input") return;
    hasLocalError = false;
    input.value = of(scene);
  };
  // Restore the value if the input could not be used.
  input.addEventListener("blur", () => {
    if (!hasUnusedInput) return;
    [hasLocalError, hasUnusedInput] = [false, false];
    mark(null);
    input.value = of(draft.scene());
  });
  return {
    element,
    path: spec.path,
    show,
    mark: (text, showText) => hasLocalError || mark(text, showText),
  };
}
