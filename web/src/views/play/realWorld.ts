// The real world in Play: choice of the world, interactions spent, and the button that runs an action.

import { all, api, ok, type Schema } from "../../api/client";
import { uniqueId, h, put, set } from "../../dom";
import type { Film } from "../../scene/film";
import type { Context } from "../../view";
import type { Task } from "./taskPicker";

export interface RealRun {
  film: Film;
  solved: boolean | null;
}

export interface RealWorld {
  element: HTMLElement;
  /** Another task: offers its real worlds. */
  about: (task: Task) => Promise<void>;
  /** Whether the action is valid. */
  ready: (placed: boolean) => void;
}

/** A task of the families that come with a real world. */
const EXAMPLE = "bowling:000";

/** `action` returns the action to run; `onRan` gets the result, `open` opens a task. */
export function realWorld(action: () => number[], onRan: (onRan: RealRun) => void, open: (task: string) => void, context: Context): RealWorld {
  let [task, worlds, placeable, busy]: [Task | null, Schema<"WorldOut">[], boolean, boolean] = [null, [], false, false];
  const id = uniqueId("world");
  const choice = h("select", { id });
  const count = h("strong", { class: "count" });
  const budgetText = h("span", { class: "soft" });
  const button = h("button", { type: "button", class: "main" }, "Run in the real world");
  const none = emptyState(open);
  const some = h("div", { class: "row" }, h("label", { for: id }, "Real world"), choice, button);
  const tally = h("p", { class: "tally", role: "status" }, "Real interactions spent: ", count, " ", budgetText);
  const selectedWorld = (): Schema<"WorldOut"> | undefined => worlds.find((w) => w.id === choice.value);
  const show = (): void => {
    const world = selectedWorld();
    some.hidden = !world;
    tally.hidden = !world;
    none.hidden = Boolean(world);
    button.disabled = !placeable || busy || world?.remaining === 0;
    put(count, world?.interactions ?? 0);
    const budget = world?.budget === null || world?.budget === undefined ? "" : `of ${world.budget}.`;
    put(budgetText, `${budget} Only this button spends interactions. ${world?.sealed ? "Its latents and effects are hidden." : ""}`);
  };
  const refresh = async (): Promise<void> => {
    const world = selectedWorld();
    if (!world) return;
    const now = await ok(api.GET("/v1/worlds/{id}", { params: { path: { id: world.id } }, signal: context.signal }));
    worlds = worlds.map((w) => (w.id === now.id ? now : w));
    show();
  };
  const run = async (): Promise<void> => {
    const world = selectedWorld();
    if (!world || !task) return;
    const of = task.family ? { task: task.id } : {};
    const body = { actions: [action()], trajectories: true, ...of };
    const batch = await ok(api.POST("/v1/worlds/{id}/rollout", { params: { path: { id: world.id } }, body, signal: context.signal }));
    const result = batch.results[0];
    if (!result?.valid || !result.t || !result.bodies) throw new Error(result?.reason ?? "the real world returned no trajectory");
    onRan({ film: { t: result.t, bodies: result.bodies, contacts: [] }, solved: result.solved ?? null });
  };
  button.addEventListener("click", () => {
    busy = true;
    context.fail(null);
    show();
    run()
      .catch(context.fail)
      // A failed run may have been counted.
      .then(refresh)
      .catch(() => undefined)
      .finally(() => {
        busy = false;
        show();
      });
  });
  choice.addEventListener("change", show);
  const about = async (now: Task): Promise<void> => {
    const everyWorld = await all(
      (cursor) => ok(api.GET("/v1/worlds", { params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal: context.signal })),
      (page) => page.worlds,
    );
    task = now;
    worlds = everyWorld.filter((w) => w.kind === "real" && (w.task === now.family || w.task === now.id));
    const selected = choice.value;
    put(choice, ...worlds.map((w) => h("option", { value: w.id, selected: w.id === selected }, w.id)));
    show();
  };
  show();
  return {
    element: h("div", { class: "card reality" }, tally, some, none),
    about,
    ready: (placed) => {
      placeable = placed;
      set(button, {});
      show();
    },
  };
}

/** The message where there is no real world, with a task that has one. */
function emptyState(open: (task: string) => void): HTMLElement {
  const example = h("button", { type: "button" }, `Open ${EXAMPLE}`);
  example.addEventListener("click", () => open(EXAMPLE));
  return h("div", { class: "row" }, h("span", { class: "soft" }, "There is no real world for this scene, so only the simulation runs. A task has one:"), example);
}
