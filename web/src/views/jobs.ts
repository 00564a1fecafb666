// Jobs, running or ended. `#/jobs` is the list, `#/jobs/job-3` one job.

import { api, ok, type Schema } from "../api/client";
import { follow } from "../api/events";
import { uniqueId, h, put } from "../dom";
import { poll } from "../parts/poll";
import { short } from "../parts/slider";
import { duration } from "../parts/time";
import { type Context, link, type View } from "../view";
import { jobLog } from "./jobs/log";
import "./jobs.css";

export const jobs: View = {
  id: "jobs",
  title: "Jobs",
  about: "All jobs, running or ended. They survive a restart of the server.",
  open: (place, context) => (context.rest[0] ? jobView(place, context.rest[0], context) : jobList(place, context)),
};

type Job = Schema<"JobOut">;
/** Rows in one page. */
const ROWS = 25;
/** Polling interval of unfinished jobs, ms. */
const POLL_MS = 1_000;
const STATES = ["queued", "running", "waiting", "succeeded", "failed", "cancelled"];

async function jobList(place: HTMLElement, context: Context): Promise<void> {
  const { signal } = context;
  const id = uniqueId("state");
  const stateFilter = context.query.get("state") ?? "";
  const state = h("select", { id }, h("option", { value: "" }, "all"), ...STATES.map((s) => h("option", { value: s, selected: s === stateFilter }, s)));
  const [newer, older] = [h("button", { type: "button" }, "Newer"), h("button", { type: "button" }, "Older")];
  const body = h("tbody");
  const none = h("p", { class: "soft", hidden: true });
  const heads = ["Job", "Kind", "State", "Progress", ""].map((t) => h("th", { scope: "col" }, t || h("span", { class: "unseen" }, "Actions")));
  const rows = h("table", { class: "jobs" }, h("caption", { class: "unseen" }, "Jobs, newest first"), h("thead", {}, h("tr", {}, ...heads)), body);
  const pages = h("div", { class: "row", role: "group", "aria-label": "Pages" }, newer, older);
  put(place, h("div", { class: "row" }, h("label", { for: id }, "Show"), state, pages), h("div", { class: "card wide" }, rows, none));
  // Cursors of the previous pages; the first page has none.
  const before: (string | undefined)[] = [];
  let [cursor, next, page]: [string | undefined, string | null, Job[]] = [undefined, null, []];
  const ask = (of: { limit: number; cursor?: string }): Promise<Schema<"JobsPage">> => {
    const query = { order: "newest", results: false, ...(state.value ? { state: state.value } : {}), ...of };
    return ok(api.GET("/v1/jobs", { params: { query }, signal }));
  };
  const show = (): void => {
    put(body, ...page.map((job) => row(job, () => void load().catch(context.fail), context)));
    [newer.disabled, older.disabled] = [before.length === 0, next === null];
    [none.hidden, rows.hidden] = [page.length > 0, page.length === 0];
    put(none, state.value ? `No job is ${state.value}.` : "No jobs yet. Estimations, diagnoses and trainings are listed here.");
  };
  const load = async (): Promise<void> => {
    const loaded = await ask({ limit: ROWS, ...(cursor ? { cursor } : {}) });
    [page, next] = [loaded.jobs, loaded.next ?? null];
    show();
  };
  const afterChange = (change: () => void) => (): void => {
    change();
    load().catch(context.fail);
  };
  older.addEventListener("click", afterChange(() => (before.push(cursor), (cursor = next ?? undefined))));
  newer.addEventListener("click", afterChange(() => (cursor = before.pop())));
  state.addEventListener("change", afterChange(() => ((before.length = 0), (cursor = undefined))));
  await load();
  const update = async (): Promise<void> => {
    const fresh = before.length === 0 ? (await ask({ limit: 1 })).jobs[0]?.id : page[0]?.id;
    if (fresh !== page[0]?.id) return load();
    // Only unfinished jobs are read again: results of ended ones may be large.
    const unfinished = page.filter((job) => !hasEnded(job));
    const now = await Promise.all(unfinished.map((job) => ok(api.GET("/v1/jobs/{id}", { params: { path: { id: job.id } }, signal }))));
    if (!now.length) return;
    const updated = new Map(now.map((job) => [job.id, job]));
    page = page.map((job) => updated.get(job.id) ?? job);
    replaceChangedRows(body, page, (job) => row(job, () => void load().catch(context.fail), context));
  };
  void poll(update, POLL_MS, context);
}

/** Replaces changed rows; a row with the focus is updated in place. */
function replaceChangedRows(body: HTMLElement, page: readonly Job[], make: (job: Job) => HTMLElement): void {
  page.forEach((job, i) => {
    const old = body.children[i] as HTMLElement | undefined;
    if (old && old.dataset.seen !== rowKey(job) && !old.contains(document.activeElement)) old.replaceWith(make(job));
    else if (old && old.dataset.seen !== rowKey(job)) put(old.querySelector(".progress")!, ...progress(job));
  });
}

function row(job: Job, changed: () => void, context: Context): HTMLElement {
  return h(
    "tr",
    { "data-job": job.id, "data-seen": rowKey(job) },
    h("th", { scope: "row" }, h("a", { href: link("jobs", [job.id]) }, job.id)),
    h("td", {}, kind(job), " ", h("span", { class: "soft" }, about(job))),
    h("td", {}, h("span", { class: `state ${job.state}` }, job.state)),
    h("td", { class: "progress" }, ...progress(job)),
    h("td", {}, button(job, changed, context)),
  );
}

/** Progress of a job, or the reason of its failure. */
function progress(job: Job): HTMLElement[] {
  if (job.state === "failed") return [h("p", { class: "why" }, job.error?.detail ?? "It failed without a message.")];
  if (hasEnded(job)) return job.state === "succeeded" ? [h("a", { href: viewOf(job) ?? link("jobs", [job.id]) }, "Result")] : [];
  const { done, total, stage, eta_s: left } = job.progress;
  const bar = total > 0 ? h("progress", { max: total, value: done, "aria-label": `Progress of ${job.id}` }) : null;
  const words = [stage || job.state, total > 0 ? `${done} of ${total}` : "", typeof left === "number" ? `${duration(left)} left` : ""];
  return [bar, h("span", { class: "soft" }, words.filter(Boolean).join(", "))].filter((e) => e !== null);
}

/** A button that cancels an unfinished job or deletes an ended one. */
function button(job: Job, changed: () => void, context: Context): HTMLElement {
  const what = hasEnded(job) ? "Delete" : "Cancel";
  const element = h("button", { type: "button", "aria-label": `${what} ${job.id}` }, what);
  element.addEventListener("click", () => {
    element.disabled = true;
    context.fail(null);
    ok(api.DELETE("/v1/jobs/{id}", { params: { path: { id: job.id } } }) as Promise<{ data?: unknown; response: Response }>)
      .then(changed)
      .catch((e: unknown) => ((element.disabled = false), context.fail(e)));
  });
  return element;
}

async function jobView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const [above, lines] = [h("div", { class: "stack" }), jobLog(id, context)];
  const show = (job: Job): void => {
    put(above, head(job, context), job.result ? result(job) : null);
    lines.update();
  };
  const job = await ok(api.GET("/v1/jobs/{id}", { params: { path: { id } }, signal }));
  put(place, h("div", { class: "stack" }, above, lines.element, jsonSection("Request", job.config)));
  show(job);
  await follow(`/v1/jobs/${encodeURIComponent(id)}/events`, (event) => show(JSON.parse(event.data) as Job), signal);
}

/** Summary of a job. */
function head(job: Job, context: Context): HTMLElement {
  const leave = (): void => void (location.hash = link("jobs"));
  const facts: [string, HTMLElement | string][] = [
    ["Kind", kind(job)],
    ["State", h("span", { class: `state ${job.state}` }, job.state)],
    ["Seed", String(job.seed)],
    ["Program", job.version],
  ];
  return h(
    "section",
    { class: "card stack", "data-job": job.id },
    h("p", {}, h("a", { href: link("jobs") }, "All jobs")),
    h("h2", {}, job.id),
    h("dl", { class: "facts" }, ...facts.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)])),
    h("div", { class: "progress" }, ...(job.state === "succeeded" ? [] : progress(job))),
    h("div", { class: "row" }, viewOf(job) ? h("a", { href: viewOf(job) }, "Open in its view") : null, button(job, leave, context)),
  );
}

function result(job: Job): HTMLElement {
  const loaded = job.result as Record<string, unknown>;
  const plain = Object.entries(loaded).flatMap(([name, v]) => (plainValue(v) === null ? [] : [[name, plainValue(v)!] as const]));
  const words = plain.slice(0, MAX_FACTS).flatMap(([name, v]) => [h("dt", {}, name.replaceAll("_", " ")), h("dd", {}, v)]);
  const save = h("button", { type: "button" }, "Save as file");
  save.addEventListener("click", () => {
    const url = URL.createObjectURL(new Blob([JSON.stringify(loaded, null, 2)], { type: "application/json" }));
    h("a", { href: url, download: `${job.id}.json` }).click();
    URL.revokeObjectURL(url);
  });
  return h("section", { class: "card stack result" }, h("h2", {}, "Result"), h("dl", { class: "facts" }, ...words), h("div", { class: "row" }, save), text("Result as JSON", loaded));
}

function jsonSection(title: string, value: unknown): HTMLElement {
  return h("section", { class: "card stack" }, h("h2", {}, title), text(`${title}, as JSON`, value));
}

/** Maximum number of facts of a result. */
const MAX_FACTS = 16;

/** Text of a scalar, or of a few named numbers; `null` for other values. */
function plainValue(value: unknown): string | null {
  if (typeof value === "string" || typeof value === "boolean") return String(value);
  if (typeof value === "number") return Number.isInteger(value) ? String(value) : short(value);
  if (typeof value !== "object" || value === null || Array.isArray(value)) return null;
  const entries = Object.entries(value);
  const isSmall = entries.length > 0 && entries.length <= 6 && entries.every(([, v]) => typeof v === "number");
  return isSmall ? entries.map(([name, v]) => `${name} ${plainValue(v)}`).join(", ") : null;
}

/** Displayed characters of JSON; the file has all. */
const MAX_JSON_CHARACTERS = 20_000;

function text(label: string, value: unknown): HTMLElement {
  const json = JSON.stringify(value, null, 2);
  const cut = json.length > MAX_JSON_CHARACTERS ? `${json.slice(0, MAX_JSON_CHARACTERS)}\n… ${json.length - MAX_JSON_CHARACTERS} more characters` : json;
  return h("pre", { tabindex: 0, role: "region", "aria-label": label }, cut);
}

/** Kind of job -> view that displays it. */
const VIEWS: Record<string, string> = { iplw: "calibrate", diagnose: "diagnose", train: "train", learn: "train", evaluate: "train" };

/** Link to the view that displays the job; `null` if there is none. */
function viewOf(job: Job): string | null {
  const view = VIEWS[job.kind];
  return view ? link(view, [job.id]) : null;
}

const KINDS: Record<string, string> = {
  iplw: "Estimation",
  diagnose: "Diagnosis",
  surface: "Surface",
  train: "Training",
  learn: "Further training",
  evaluate: "Evaluation",
};

/** Kind of job, linked to its view. */
function kind(job: Job): HTMLElement {
  const [named, at] = [KINDS[job.kind] ?? job.kind, viewOf(job)];
  return h("strong", {}, at ? h("a", { href: at }, named) : named);
}

function about(job: Job): string {
  const config = job.config as Record<string, unknown>;
  const named = ["task", "world", "policy"].map((key) => config[key]).filter((v) => typeof v === "string");
  return named.join(", ");
}

function hasEnded(job: Job): boolean {
  return ["succeeded", "failed", "cancelled"].includes(job.state);
}

function rowKey(job: Job): string {
  return JSON.stringify([job.state, job.progress]);
}

export { duration };
