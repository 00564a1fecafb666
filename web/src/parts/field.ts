// Form fields: label, input, unit, error message.

import { uniqueId, h, put, set } from "../dom";

export interface Field {
  element: HTMLElement;
  input: HTMLInputElement | HTMLSelectElement;
  /** Displays an error; `null` removes it. */
  refuse: (why: string | null) => void;
}

/** A number, `null` while empty. `onChange` is called with every valid input; `hint` is a sentence of help. */
export function numeric(label: string, unit: string, value: number | null, onChange: (value: number | null) => void, hint = ""): Field {
  const input = h("input", { type: "text", inputmode: "decimal", autocomplete: "off", value: value === null ? "" : String(value), class: "number" });
  const field = buildField(label, input, unit, hint);
  input.addEventListener("input", () => {
    const text = input.value.trim().replace(",", ".");
    const now = text === "" ? null : Number(text);
    if (now !== null && !Number.isFinite(now)) return field.refuse(`${input.value} is not a number.`);
    field.refuse(null);
    onChange(now);
  });
  return field;
}

/** A choice; options are pairs of value and label. */
export function choice(label: string, options: readonly (readonly [string, string])[], value: string, onChange: (value: string) => void, hint = ""): Field {
  const input = h("select", {}, ...options.map(([v, text]) => h("option", { value: v, selected: v === value }, text)));
  const field = buildField(label, input, "", hint);
  input.addEventListener("change", () => (field.refuse(null), onChange(input.value)));
  return field;
}

/** Radio buttons in a row. */
export function radios(label: string, options: readonly (readonly [string, string])[], value: string, onChange: (value: string) => void): HTMLElement {
  const name = uniqueId("radio");
  const labels = options.map(([v, text]) => {
    const input = h("input", { type: "radio", name, value: v, checked: v === value });
    input.addEventListener("change", () => onChange(v));
    return h("label", { class: "radio" }, input, text);
  });
  return h("fieldset", { class: "radios" }, h("legend", {}, label), h("div", { class: "row" }, ...labels));
}

function buildField(label: string, input: HTMLInputElement | HTMLSelectElement, unit: string, hint: string): Field {
  const [id, whyId, hintId] = [uniqueId("field"), uniqueId("why"), uniqueId("hint")];
  const why = h("span", { id: whyId, class: "refused-why", hidden: true });
  set(input, { id, "aria-describedby": hint ? hintId : null });
  const element = h("div", { class: "field" }, h("label", { for: id }, label), input, unit ? h("span", { class: "soft" }, unit) : null, hint ? h("span", { id: hintId, class: "soft hint" }, hint) : null, why);
  const refuse = (text: string | null): void => {
    put(why, text);
    why.hidden = text === null;
    set(input, { "aria-invalid": text !== null ? "true" : null, "aria-describedby": [hint ? hintId : "", text !== null ? whyId : ""].join(" ").trim() || null });
  };
  return { element, input, refuse };
}
