// The list of jobs: pages of the server; each page can be sorted and searched.

import { api, ok } from "../../api/client";
import { hasEnded } from "../../api/jobState";
import { h, put, set } from "../../dom";
import { poll } from "../../parts/poll";
import { type Context, link } from "../../view";
import { emptyList } from "./empty";
import { addressOf, COLUMN_NAMES, type Filters, filters, orderOf } from "./filters";
import { type Job, readJob } from "./job";
import { type Column, COLUMNS, type Order, sorted, startsDescending, withText } from "./order";
import { type JobRow, jobRow } from "./row";
import { selection } from "./selection";

/** Rows in one page. */
const ROWS = 100;
/** Polling interval of unfinished jobs, ms. */
const POLL_MS = 1_000;

interface Page {
  jobs: Job[];
  next: string | null;
  /** Cursor of this page, and those of the pages before it; the first page has none. */
  cursor: string | undefined;
  before: (string | undefined)[];
}

export async function jobList(place: HTMLElement, context: Context): Promise<void> {
  const controls = filters(context);
  const page: Page = { jobs: [], next: null, cursor: undefined, before: [] };
  const picked = selection(context.query.get("with"));
  let order = orderOf(context);
  const table = jobTable((by) => sortBy({ by, descending: by === order.by ? !order.descending : startsDescending(by) }));
  const [newer, older] = [h("button", { type: "button" }, "Newer"), h("button", { type: "button" }, "Older")];
  const pages = h("div", { class: "row", role: "group", "aria-label": "Pages" }, newer, older);
  const note = h("p", { class: "soft small", role: "status" });
  const none = h("div", { class: "none", hidden: true });
  put(place, h("div", { class: "job-filters" }, ...controls.elements), h("div", { class: "row between job-bar" }, picked.element, pages), note, h("div", { class: "card wide jobs-card" }, table.element, none));
  const rows = new Map<string, JobRow>();
  const rowOf = (job: Job): JobRow => {
    const old = rows.get(job.id);
    const row = old ?? jobRow(job, { ticked: () => picked.toggle(job.id, row.tick.checked), removed: () => void load().catch(context.fail) }, context);
    rows.set(job.id, row);
    row.tick.checked = picked.has(job.id);
    if (old) row.show(job);
    return row;
  };
  const show = (): void => {
    const visible = sorted(withText(page.jobs, controls.text.value), order);
    table.show(visible.map((job) => rowOf(job).element), order, page.jobs.some((job) => job.owner != null));
    [newer.disabled, older.disabled] = [page.before.length === 0, page.next === null];
    pages.hidden = newer.disabled && older.disabled;
    [table.element.hidden, none.hidden] = [!visible.length, visible.length > 0];
    put(note, scopeText(visible.length, page));
    note.hidden = !note.textContent;
    if (!visible.length) emptyList(none, { loaded: page.jobs.length, state: controls.state.value, kind: controls.kind.value, text: controls.text.value }, () => void load().catch(context.fail), context);
  };
  const load = async (): Promise<void> => {
    const loaded = await request(controls, context, { limit: ROWS, ...(page.cursor ? { cursor: page.cursor } : {}) });
    [page.jobs, page.next] = [loaded.jobs, loaded.next ?? null];
    for (const id of rows.keys()) if (!page.jobs.some((job) => job.id === id)) rows.delete(id);
    show();
  };
  const remember = (): void => history.replaceState(null, "", link("jobs", [], addressOf(controls, order)));
  const sortBy = (now: Order): void => {
    order = now;
    controls.order.value = order.by;
    remember();
    show();
  };
  const reload = (change: () => void) => (): void => {
    change();
    remember();
    load().catch(context.fail);
  };
  const first = (): void => void ((page.before.length = 0), (page.cursor = undefined));
  older.addEventListener("click", reload(() => (page.before.push(page.cursor), (page.cursor = page.next ?? undefined))));
  newer.addEventListener("click", reload(() => (page.cursor = page.before.pop())));
  for (const input of [controls.state, controls.kind]) input.addEventListener("change", reload(first));
  controls.text.addEventListener("input", () => (remember(), show()));
  controls.order.addEventListener("change", () => sortBy({ by: controls.order.value as Column, descending: startsDescending(controls.order.value as Column) }));
  await load();
  void poll(async () => ((await update(page, controls, context)) ? load() : show()), POLL_MS, context);
}

function request(controls: Filters, context: Context, of: { limit: number; cursor?: string }): Promise<{ jobs: Job[]; next?: string | null }> {
  const [state, kind] = [controls.state.value, controls.kind.value];
  const query = { order: "newest", results: false, ...(state ? { state } : {}), ...(kind ? { kind } : {}), ...of };
  return ok(api.GET("/v1/jobs", { params: { query }, signal: context.signal }));
}

/** Reads unfinished jobs again; returns whether there are new jobs, so that the page must be loaded. */
async function update(page: Page, controls: Filters, context: Context): Promise<boolean> {
  const newest = page.before.length === 0 ? (await request(controls, context, { limit: 1 })).jobs[0]?.id : page.jobs[0]?.id;
  if (newest !== page.jobs[0]?.id) return true;
  const now = await Promise.all(page.jobs.filter((job) => !hasEnded(job)).map((job) => readJob(job.id, context.signal)));
  const updated = new Map(now.map((job) => [job.id, job]));
  // Only a list needs no results, which may be large.
  page.jobs = page.jobs.map((job) => (updated.has(job.id) ? { ...updated.get(job.id)!, result: null } : job));
  return false;
}

/** Text that tells how far sorting and searching reach. */
function scopeText(visible: number, page: Page): string {
  const all = page.jobs.length;
  const matches = visible < all ? `${visible} of ${all} jobs match. ` : "";
  const isPart = page.next !== null || page.before.length > 0;
  return matches + (isPart ? `Search and order apply to the ${all} jobs of this page; ${page.next !== null ? "older" : "newer"} jobs are on other pages.` : "");
}

interface JobTable {
  element: HTMLElement;
  show: (rows: readonly HTMLElement[], order: Order, owned: boolean) => void;
}

/** The table; a click on a head sorts by its column. */
function jobTable(onSort: (by: Column) => void): JobTable {
  const heads = COLUMNS.map((by) => {
    const button = h("button", { type: "button", class: "quiet sort" }, COLUMN_NAMES[by], h("span", { class: "arrow", "aria-hidden": "true" }));
    button.addEventListener("click", () => onSort(by));
    return h("th", { scope: "col", "data-column": by }, button);
  });
  const [tick, actions] = ["Select", "Actions"].map((t) => h("th", { scope: "col" }, h("span", { class: "unseen" }, t)));
  const body = h("tbody");
  const element = h("table", { class: "jobs" }, h("caption", { class: "unseen" }, "Jobs"), h("thead", {}, h("tr", {}, tick, ...heads, actions)), body);
  const show = (rows: readonly HTMLElement[], order: Order, owned: boolean): void => {
    heads.forEach((head, i) => set(head, { "aria-sort": COLUMNS[i] === order.by ? (order.descending ? "descending" : "ascending") : null }));
    element.classList.toggle("without-owners", !owned);
    const isSame = rows.length === body.children.length && rows.every((row, i) => body.children[i] === row);
    if (isSame) return;
    const focus = document.activeElement as HTMLElement | null;
    put(body, ...rows);
    if (focus && body.contains(focus)) focus.focus();
  };
  return { element, show };
}
