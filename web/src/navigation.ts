// The navigation: groups of views in a row; on a narrow screen a button unfolds them.

import { h, put, set, uniqueId } from "./dom";
import { link, type ViewGroup } from "./view";

export interface Navigation {
  nav: HTMLElement;
  /** The button that unfolds it on a narrow screen. */
  menu: HTMLButtonElement;
  /** Marks the open view and folds the menu. */
  showCurrent: (id: string) => void;
}

/** Links to all views, in their groups. */
export function navigation(groups: readonly ViewGroup[]): Navigation {
  const id = uniqueId("views");
  const nav = h("nav", { id, "aria-label": "Views" }, h("ul", { class: "view-groups" }, ...groups.map(groupItem)));
  const menu = h("button", { type: "button", class: "menu", "aria-controls": id, "aria-expanded": "false" });
  const unfold = (open: boolean): void => {
    nav.classList.toggle("unfolded", open);
    set(menu, { "aria-expanded": String(open) });
    put(menu, open ? "Close" : "Menu");
  };
  menu.addEventListener("click", () => unfold(menu.getAttribute("aria-expanded") === "false"));
  addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || menu.getAttribute("aria-expanded") === "false") return;
    unfold(false);
    menu.focus();
  });
  // The open view's own link does not change the address.
  nav.addEventListener("click", (event) => {
    if ((event.target as Element).closest("a")) unfold(false);
  });
  unfold(false);
  const showCurrent = (view: string): void => {
    unfold(false);
    for (const a of nav.querySelectorAll("a")) set(a, { "aria-current": a.dataset.view === view ? "page" : null });
  };
  return { nav, menu, showCurrent };
}

function groupItem({ title, views }: ViewGroup): HTMLElement {
  const id = uniqueId("group");
  const items = views.map((view) => h("li", {}, h("a", { href: link(view.id), "data-view": view.id }, view.title)));
  return h("li", {}, h("span", { id, class: "group-title" }, title), h("ul", { "aria-labelledby": id }, ...items));
}
