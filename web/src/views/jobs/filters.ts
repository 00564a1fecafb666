// Filters of the list of jobs: text, state and kind; and the order, where a narrow screen has no column heads.

import { h, uniqueId } from "../../dom";
import type { Context } from "../../view";
import { KINDS, STATES } from "./job";
import { type Column, COLUMNS, NEWEST_FIRST, type Order, startsDescending } from "./order";

export interface Filters {
  elements: HTMLElement[];
  text: HTMLInputElement;
  state: HTMLSelectElement;
  kind: HTMLSelectElement;
  order: HTMLSelectElement;
}

export const COLUMN_NAMES: Record<Column, string> = { name: "Name", kind: "Kind", state: "State", started: "Started", duration: "Duration", who: "Who", result: "Result" };

/** The filters with the values of the address. */
export function filters(context: Context): Filters {
  const { query } = context;
  const select = (options: readonly (readonly [string, string])[], value: string): HTMLSelectElement => h("select", { id: uniqueId("filter") }, ...options.map(([v, label]) => h("option", { value: v, selected: v === value }, label)));
  const state = select([["", "all"], ...STATES.map((s) => [s, s] as const)], query.get("state") ?? "");
  const kind = select([["", "all"], ...Object.entries(KINDS)], query.get("kind") ?? "");
  const text = h("input", { id: uniqueId("filter"), type: "search", class: "search", autocomplete: "off", placeholder: "name, note, task or id", value: query.get("text") ?? "" });
  const orders = COLUMNS.map((by) => [orderKey({ by, descending: startsDescending(by) }), COLUMN_NAMES[by].toLowerCase()] as const);
  const order = select(orders, orderKey(orderOf(context)));
  const field = (label: string, input: HTMLElement, look = ""): HTMLElement => h("div", { class: `filter ${look}` }, h("label", { for: input.id }, label), input);
  const elements = [field("Search", text, "wide-filter"), field("State", state), field("Kind", kind), field("Sort by", order, "narrow-only")];
  return { elements, text, state, kind, order };
}

/** The order in the address. */
export function orderOf(context: Context): Order {
  const by = COLUMNS.find((column) => column === context.query.get("sort")) ?? NEWEST_FIRST.by;
  const direction = context.query.get("direction");
  return { by, descending: direction ? direction === "down" : startsDescending(by) };
}

/** The parts of an address that give filters and order; defaults are omitted. */
export function addressOf(of: Filters, order: Order): Record<string, string> {
  const isDefault = order.by === NEWEST_FIRST.by && order.descending;
  const parts = { text: of.text.value.trim(), state: of.state.value, kind: of.kind.value, ...(isDefault ? {} : { sort: order.by, direction: order.descending ? "down" : "up" }) };
  return Object.fromEntries(Object.entries(parts).filter(([, value]) => value !== ""));
}

function orderKey(order: Order): string {
  return order.by;
}
