// Fields of a form over a draft: each shows what stands at its path, writes there what is typed, and can be marked wrong.

import { uniqueId, h, put, set } from "../../dom";
import type { Scene } from "../../scene/types";
import { affectedFields, read, write } from "./path";

/** The draft that a form is about. */
export interface Draft {
  scene: () => Scene;
  /** Another scene; changes with the same key are undone together. */
  change: (scene: Scene, key: string | null) => void;
}

export interface Field {
  element: HTMLElement;
  /** As the server names it. */
  path: string;
  show: (scene: Scene) => void;
  /** Marks it wrong and says why, where it is not said elsewhere; `null` takes that away. */
  mark: (message: string | null, showText?: boolean) => void;
}

/** What stands at a path that the scene leaves out, and what happens where nothing is typed. */
export interface FieldSpec {
  label: string;
  path: string;
  unit?: string;
  /** What an empty field means; a field without it cannot be empty. */
  empty?: string;
  /** The whole pair where a path is one of two numbers, and the scene has none. */
  pair?: [number, number];
  whole?: boolean;
  /** What else the form calls it, for screen readers: of which corner, say. */
  of?: string;
}

/** A number, in SI units. */
export function number(draft: Draft, spec: FieldSpec): Field {
  const input = h("input", { type: "number", step: "any", inputmode: "decimal", placeholder: spec.empty });
  return field(draft, spec, input, (scene) => {
    const now = read(scene, spec.path);
    // Ninths of a millionth are rounding: they stay in the scene, and out of sight.
    return typeof now === "number" ? String(Number(now.toPrecision(9))) : "";
  }, (text) => {
    const value = text === "" ? undefined : Number(text);
    if (value === undefined && spec.empty === undefined) return "A number is needed here.";
    if (value !== undefined && !Number.isFinite(value)) return "This is no number.";
    draft.change(withNumber(draft.scene(), spec, value), `type-${spec.path}`);
    return null;
  }, "input");
}

/** A text; `changed` makes the scene of it, or says why it cannot be. */
export function text(draft: Draft, spec: FieldSpec, changed: (scene: Scene, value: string) => Scene | string): Field {
  const input = h("input", { type: "text", autocomplete: "off", spellcheck: "false" });
  return field(draft, spec, input, (scene) => String(read(scene, spec.path) ?? ""), (value) => {
    const next = changed(draft.scene(), value);
    if (typeof next === "string") return next;
    draft.change(next, `type-${spec.path}`);
    return null;
  }, "input");
}

/** One of a list; `of` says which stands in the scene, `changed` makes the scene of another one. */
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
    // A name that no thing has (any more) is shown, and the server says so.
    if (![...input.options].some((o) => o.value === now)) input.append(h("option", { value: now }, now || "none"));
    return now;
  };
  return field(draft, spec, input, show, (value) => {
    draft.change(changed(draft.scene(), value), null);
    return null;
  }, "change");
}

/** A name among others at a path. */
export function nameChoice(draft: Draft, spec: FieldSpec, names: readonly string[]): Field {
  const options = names.map((n): [string, string] => [n, n]);
  return choice(draft, spec, options, (scene) => String(read(scene, spec.path) ?? ""), (scene, value) => write(scene, spec.path, value));
}

/** Fields side by side under a title. */
export function group(title: string, ...parts: (Field | HTMLElement)[]): HTMLElement {
  return h("fieldset", { class: "fields" }, h("legend", {}, title), ...parts.map((p) => ("path" in p ? p.element : p)));
}

/** Marks the fields that a problem is about; whether there were any. */
export function markFields(fields: readonly Field[], problem: { field: string; message: string } | null): Field[] {
  const paths = problem ? affectedFields(fields.map((f) => f.path), problem.field) : [];
  const invalid = fields.filter((f) => paths.includes(f.path));
  // Said once, at the first.
  for (const f of fields) f.mark(invalid.includes(f) ? problem!.message : null, f === invalid[0]);
  return invalid;
}

/** The scene with a number at a path; of a pair that the scene leaves out, the other is as it is understood. */
export function withNumber(scene: Scene, { path, pair, empty }: FieldSpec, value: number | undefined): Scene {
  const [, parent, index] = /^(.*)\[(\d)\]$/.exec(path) ?? [];
  if (!pair || parent === undefined) return write(scene, path, value);
  const now = (read(scene, parent) as [number, number] | null | undefined) ?? pair;
  // Half a pair cannot be left out.
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
    // Across all columns, where there are some.
    const row = element.closest(".fields, .corner") ?? element;
    if (message.parentElement !== row) row.append(message);
  };
  let [hasLocalError, hasUnusedInput] = [false, false];
  input.addEventListener(event, () => {
    // Half a number ("-") is waited for.
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
  // What could not be used is not left standing.
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
