// Facts of a job as a table: times, owner, and its request, flattened; the raw JSON folded.

import { type Child, h, put } from "../../dom";
import { flatten } from "./flatten";
import { type Job, kindOf, viewOf } from "./job";
import { date, runtimeOf } from "./times";

/** Maximum number of rows of a request; the JSON has all. */
const MAX_ROWS = 60;
/** Displayed characters of JSON; the file has all. */
const MAX_JSON_CHARACTERS = 20_000;

export interface Details {
  element: HTMLElement;
  show: (job: Job) => void;
}

export function details(): Details {
  const body = h("tbody");
  const [raw, more] = [h("div", { class: "raw" }), h("p", { class: "soft small" })];
  const table = h("table", { class: "details" }, h("caption", { class: "unseen" }, "Details of the job"), body);
  const element = h("section", { class: "card stack", "aria-label": "Details" }, h("h2", {}, "Details"), table, more, raw);
  let key = "";
  const show = (job: Job): void => {
    const settings = flatten(job.config).filter((s) => s.path !== "seed");
    put(body, ...facts(job).map(([name, value]) => row(name, value)), ...settings.slice(0, MAX_ROWS).map((s) => row(s.path, s.text)));
    put(more, settings.length > MAX_ROWS ? `${settings.length - MAX_ROWS} more settings are in the JSON.` : null);
    more.hidden = settings.length <= MAX_ROWS;
    const now = JSON.stringify([job.state, job.name]);
    if (now !== key) put(raw, folded("Request as JSON", job.config), job.result ? folded("Result as JSON", job.result) : null);
    key = now;
  };
  return { element, show };
}

function facts(job: Job): [string, Child][] {
  const time = (at: number | null | undefined): Child => (at == null ? null : date(at));
  const all: [string, Child][] = [
    ["job", job.id],
    ["kind", viewOf(job) ? h("a", { href: viewOf(job) }, kindOf(job)) : kindOf(job)],
    ["owner", job.owner],
    ["queued", time(job.created)],
    ["started", time(job.started)],
    ["ended", time(job.ended)],
    ["duration", job.started == null ? null : runtimeOf(job)],
    ["seed", String(job.seed)],
    ["program", `iplw ${job.version}`],
  ];
  return all.filter(([, value]) => value !== null && value !== undefined);
}

function row(name: string, value: Child): HTMLElement {
  return h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, value));
}

/** JSON that is formatted when it is unfolded. */
function folded(label: string, value: unknown): HTMLElement {
  const text = h("pre", { tabindex: 0, role: "region", "aria-label": label });
  const element = h("details", {}, h("summary", {}, label), text);
  element.addEventListener("toggle", () => text.textContent || put(text, format(value)));
  return element;
}

function format(value: unknown): string {
  const json = JSON.stringify(value, null, 2);
  const more = json.length - MAX_JSON_CHARACTERS;
  return more > 0 ? `${json.slice(0, MAX_JSON_CHARACTERS)}\n… ${more} more characters` : json;
}
