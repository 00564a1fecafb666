import { type Child, h } from "../dom";

/** A text of the server, in which names between backticks are code. */
export function codeText(text: string): Child[] {
  return text.split("`").map((part, i) => (i % 2 === 1 ? h("code", {}, part) : part));
}
