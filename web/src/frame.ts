// The frame around every view: navigation, banner, sign-in, errors; opens the view of the address.

import { unauthorized } from "./api/client";
import { reconnected, isLost, onConnectionChange } from "./api/connection";
import { describeError, ProblemError } from "./api/problem";
import { h, put, set } from "./dom";
import { navigation } from "./navigation";
import { signedIn, signIn, signOut } from "./signin";
import { currentTheme, toggleTheme } from "./theme";
import { parseAddress, type View, type ViewGroup } from "./view";

/** Builds the page and opens the view of the address. */
export function start(groups: readonly ViewGroup[]): void {
  const views = groups.flatMap((group) => group.views);
  const parts = build(groups);
  document.body.append(...parts.all);
  let leave = new AbortController();
  const show = (): void => {
    leave.abort();
    leave = new AbortController();
    open(views, parts, leave.signal);
  };
  addEventListener("hashchange", show);
  onConnectionChange((lost) => (parts.banner.hidden = !lost));
  parts.banner.hidden = !isLost();
  unauthorized.addEventListener("needed", () => signIn(parts.main, show));
  signedIn((now) => (parts.out.hidden = !now));
  parts.out.addEventListener("click", () => {
    signOut();
    show();
  });
  show();
}

interface Parts {
  all: HTMLElement[];
  showCurrent: (id: string) => void;
  main: HTMLElement;
  heading: HTMLElement;
  about: HTMLElement;
  banner: HTMLElement;
  errors: HTMLElement;
  status: HTMLElement;
  place: HTMLElement;
  out: HTMLButtonElement;
}

function build(groups: readonly ViewGroup[]): Parts {
  const { nav, menu, showCurrent } = navigation(groups);
  const out = h("button", { type: "button", class: "quiet", hidden: true }, "Sign out");
  const theme = h("button", { type: "button", class: "quiet" });
  const updateLabel = (): void => {
    const other = currentTheme() === "dark" ? "Light" : "Dark";
    put(set(theme, { "aria-label": `${other} theme` }), other);
  };
  theme.addEventListener("click", () => (toggleTheme(), updateLabel()));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", updateLabel);
  updateLabel();
  const docs = h("a", { href: "/docs/", class: "quiet" }, "API");
  const brand = h("a", { href: "#/", class: "brand" }, "iplw");
  const header = h("header", {}, brand, menu, nav, h("div", { class: "tools" }, docs, theme, out));
  const banner = h(
    "div",
    { class: "banner", role: "alert", hidden: true },
    "Connection lost: the server does not respond. Jobs and this page continue when it is back.",
  );
  const heading = h("h1", { tabindex: "-1" });
  const about = h("p", { class: "about" });
  const errors = h("div", { class: "errors", role: "alert" });
  const status = h("div", { class: "unseen", role: "status", "aria-live": "polite" });
  const place = h("div", { class: "place" });
  const main = h("main", { id: "main" }, h("div", { class: "title" }, heading, about), errors, place);
  const skip = h("a", { href: "#main", class: "skip" }, "Skip to the view");
  // The address is used by the views.
  skip.addEventListener("click", (e) => (e.preventDefault(), heading.focus()));
  return { all: [skip, header, banner, main, status], showCurrent, main, heading, about, banner, errors, status, place, out };
}

function open(views: readonly View[], parts: Parts, signal: AbortSignal): void {
  const address = parseAddress(location.hash);
  const view = views.find((v) => v.id === address.view) ?? views[0];
  if (!view) return;
  parts.showCurrent(view.id);
  const navigated = document.title !== "iplw" && !document.title.startsWith(view.title);
  document.title = `${view.title} · iplw`;
  put(parts.heading, view.title);
  put(parts.about, view.about);
  put(parts.errors);
  if (navigated) parts.heading.focus();
  const fail = (error: unknown): void => {
    if (!signal.aborted) show(parts.errors, error);
  };
  const say = (text: string): void => void put(parts.status, text);
  const run = async (): Promise<void> => view.open(put(parts.place), { ...address, signal, fail, say });
  run().catch((error: unknown) => {
    fail(error);
    // Nothing was displayed: open the view again when the server is back.
    if (isLost()) void reconnected().then(() => signal.aborted || open(views, parts, signal));
  });
}

/** Displays an error; `null` removes it. */
function show(place: HTMLElement, error: unknown): void {
  if (error === null || error === undefined) return void put(place);
  if (error instanceof DOMException && error.name === "AbortError") return;
  // Handled by the sign-in dialogue.
  if (error instanceof ProblemError && error.problem.status === 401) return;
  const { title, detail, field } = describeError(error);
  const close = h("button", { type: "button", class: "quiet", "aria-label": "Close the message" }, "×");
  close.addEventListener("click", () => put(place));
  const text = h("p", {}, h("strong", {}, title), ": ", detail, field ? h("code", {}, ` ${field}`) : null);
  put(place, h("div", { class: "error" }, text, close));
}
