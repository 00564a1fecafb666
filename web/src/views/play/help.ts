// Help at a field.

import { h, set, uniqueId } from "../../dom";

/** A field with a line of help below it, which screen readers read with the field. */
export function withHelp(field: HTMLElement, text: string): HTMLElement {
  const id = uniqueId("help");
  const input = field.querySelector("input, select, button");
  if (input) set(input, { "aria-describedby": id });
  return h("div", { class: "with-help" }, field, h("p", { id, class: "help" }, text));
}
