// The list of worlds in pages, by last use or by id.

import { api, ok } from "../../api/client";
import { poll } from "../../parts/poll";
import { ago } from "../../parts/time";
import { uniqueId, h, put } from "../../dom";
import { type Context, link } from "../../view";
import { createExample } from "./example";
import { guide } from "./guide";
import type { World } from "./messages";

/** Rows in one page. */
const ROWS = 25;
/** Polling interval, ms. */
const POLL_MS = 2_000;

export async function worldList(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const id = uniqueId("order");
  const order = h("select", { id }, h("option", { value: "used" }, "last used first"), h("option", { value: "id" }, "by id"));
  const [back, forward] = [h("button", { type: "button" }, "Back"), h("button", { type: "button" }, "More")];
  const [head, body] = [h("tr"), h("tbody")];
  const table = h("table", { class: "worlds" }, h("caption", { class: "unseen" }, "Worlds"), h("thead", {}, head), body);
  const pages = h("div", { class: "row", role: "group", "aria-label": "Pages" }, back, forward);
  const none = h("p", { class: "soft", hidden: true }, "No worlds yet.");
  put(place, h("div", { class: "row" }, h("label", { for: id }, "Order"), order, pages), h("div", { class: "card wide" }, table, none), guideSection(context));
  // Cursors of the previous pages; the first page has none.
  const before: (string | undefined)[] = [];
  let [cursor, next]: [string | undefined, string | null] = [undefined, null];
  const load = async (): Promise<void> => {
    const query = { order: order.value, limit: ROWS, ...(cursor ? { cursor } : {}) };
    const page = await ok(api.GET("/v1/worlds", { params: { query }, signal }));
    next = page.next ?? null;
    [back.disabled, forward.disabled] = [before.length === 0, next === null];
    const owned = page.worlds.some((w) => w.owner);
    const heads = ["World", "Task", "Kind", ...(owned ? ["Owner"] : []), "Interactions", "Episodes", "Last use"];
    put(head, ...heads.map((t) => h("th", { scope: "col" }, t)));
    [none.hidden, table.hidden] = [page.worlds.length > 0, !page.worlds.length];
    updateRows(body, page.worlds, owned);
  };
  const afterChange = (change: () => void) => (): void => {
    change();
    load().catch(context.fail);
  };
  forward.addEventListener("click", afterChange(() => (before.push(cursor), (cursor = next ?? undefined))));
  back.addEventListener("click", afterChange(() => (cursor = before.pop())));
  order.addEventListener("change", afterChange(() => ((before.length = 0), (cursor = undefined))));
  await load();
  void poll(load, POLL_MS, context);
}

/** How a program gets a world into the list. */
function guideSection(context: Context): HTMLElement {
  const button = h("button", { type: "button", class: "main" }, "Start an example world");
  button.addEventListener("click", () => {
    button.disabled = true;
    context.fail(null);
    createExample(context.signal)
      .then((id) => (location.hash = link("live", [id], { example: "1" })))
      .catch((e: unknown) => ((button.disabled = false), context.fail(e)));
  });
  return h("section", { class: "card stack", "aria-label": "Watch a program" }, h("h2", {}, "Watch a program"), guide(null, button));
}

/** Updates the rows; unchanged rows keep the focus. */
function updateRows(body: HTMLElement, worlds: readonly World[], owned: boolean): void {
  const rowsByKey = new Map([...body.children].map((row) => [(row as HTMLElement).dataset.seen, row]));
  const focus = document.activeElement?.closest("tr")?.dataset.world;
  const rows = worlds.map((world) => {
    const cells = worldCells(world, owned);
    const key = JSON.stringify([world.id, ...cells]);
    return rowsByKey.get(key) ?? row(world, cells, key);
  });
  const changed = rows.some((row, i) => body.children[i] !== row) || body.children.length !== rows.length;
  if (!changed) return;
  put(body, ...rows);
  if (focus) (body.querySelector(`tr[data-world="${CSS.escape(focus)}"] a`) as HTMLElement | null)?.focus();
}

function row(world: World, cells: [string, string][], key: string): HTMLElement {
  const first = h("th", { scope: "row" }, h("a", { href: link("live", [world.id]) }, world.id));
  return h("tr", { "data-world": world.id, "data-seen": key }, first, ...cells.map(([name, text]) => h("td", { "data-name": name }, text)));
}

/** The cells of a world, with labels for narrow screens. */
function worldCells(world: World, owned: boolean): [string, string][] {
  const task = world.state.task && world.state.task !== world.task ? `${world.task}, now ${world.state.task}` : world.task;
  return [
    ["Task", task],
    ["Kind", world.kind === "real" ? (world.sealed ? "real, hidden" : "real") : world.sealed ? "simulated, hidden" : "simulated"],
    ...(owned ? [["Owner", world.owner ?? "everybody"] as [string, string]] : []),
    ["Interactions", world.budget == null ? String(world.interactions) : `${world.interactions} of ${world.budget}`],
    ["Episodes", String(world.state.episodes)],
    ["Last use", ago(world.idle_s)],
  ];
}
