// One world, watched: what a program does in it, step by step, with the film of what was observed.

import { ok, api, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { uniqueId, h, put } from "../../dom";
import { short } from "../../parts/slider";
import type { Film } from "../../scene/film";
import type { Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { loadTask } from "../play/taskPicker";
import { filmPlayer, type FilmPlayer } from "./filmPlayer";
import { applyEvent, type WorldEvent, eventText, countsInteraction, verdict, waitingFor, type World } from "./messages";

/** Events that stay in the list. */
const MAX_EVENTS_LISTED = 50;
/** Least time between two pictures of a program that acts faster than one can look, ms. */
const MIN_FRAME_INTERVAL_MS = 150;

/** What is known of the world that is watched. */
interface WatchState {
  world: World;
  /** Scenes by task: fetched once. */
  scenes: Map<string, Promise<Scene>>;
  missed: number;
  last: number;
}

export async function worldView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const path = { id };
  // Who may not see it is told so in the server's words, before anything is followed.
  const watch: WatchState = { world: await ok(api.GET("/v1/worlds/{id}", { params: { path }, signal })), scenes: new Map(), missed: 0, last: 0 };
  const [facts, front] = [h("div"), h("div", { class: "front" })];
  const log = h("ol", { class: "happened", reversed: true, "aria-label": "What happened, newest first" });
  const noEvents = h("p", { class: "soft" }, "Nothing has happened since you look on. Steps of a program appear here.");
  const status = h("p", { class: "soft", role: "status" }, "Connecting …");
  const box = uniqueId("follow");
  const newest = h("input", { id: box, type: "checkbox", checked: true });
  const head = h("section", { class: "card stack", "aria-label": "World" }, h("p", {}, h("a", { href: link("live") }, "All worlds")), h("h2", {}, id), facts);
  const events = h("section", { class: "card stack", "aria-label": "What happens" }, h("h2", {}, "What happens"), status, h("div", { class: "row" }, newest, h("label", { for: box }, "Show the newest film at once")), noEvents, log);
  put(place, h("div", { class: "live-body" }, front, h("div", { class: "stack" }, head, events)));
  let shown: { task: string; screen: FilmPlayer } | null = null;
  const playerFor = async (task: string): Promise<FilmPlayer> => {
    if (shown?.task !== task) {
      const scene = await sceneOf(watch, task, signal);
      shown = { task, screen: filmPlayer(scene, `Scene of ${task} in ${id}`, context) };
      put(front, shown.screen.element);
    }
    return shown.screen;
  };
  const show = async (event: WorldEvent): Promise<void> => {
    if (!event.task) return;
    const at = await playerFor(event.task);
    if (event.what === "reset") at.empty("The episode has begun: an action is waited for.");
    else at.show(event.action ?? [], event.film ? (event.film as unknown as Film) : null, verdict(event));
  };
  const render = throttled((waiting: WorldEvent[]) => {
    put(facts, ...worldFacts(watch.world));
    const rows = waiting.slice(-MAX_EVENTS_LISTED).reverse().map((event) => eventRow(event, () => ((newest.checked = false), void show(event).catch(context.fail))));
    log.prepend(...rows);
    while (log.childElementCount > MAX_EVENTS_LISTED) log.lastElementChild!.remove();
    noEvents.hidden = log.childElementCount > 0;
    put(status, watch.missed ? `Watching. ${watch.missed} events came faster than they could be shown.` : "Watching.");
    const last = waiting.filter((e) => e.what === "reset" || e.what === "step" || e.film).at(-1);
    if (last && newest.checked) show(last).catch(context.fail);
  }, signal);
  const onEvent = (data: string, name: string): void => {
    if (name === "world") {
      const first = JSON.parse(data) as Schema<"WatchOut">;
      watch.world = first.world;
      watch.scenes.set(first.task, Promise.resolve(first.scene as unknown as Scene));
      if (!shown) void playerFor(first.task).then((s) => s.empty(waitingFor(first.world))).catch(context.fail);
      render(null);
      return;
    }
    const event = JSON.parse(data) as WorldEvent;
    if (watch.last && event.number > watch.last + 1) watch.missed += event.number - watch.last - 1;
    watch.last = event.number;
    watch.world = applyEvent(watch.world, event);
    render(event);
  };
  await follow(`/v1/worlds/${encodeURIComponent(id)}/events`, (e) => onEvent(e.data, e.event), signal, "gone");
  if (!signal.aborted) put(status, "The world is gone: it was deleted, or nobody had used it for a while.");
}

/** A task's scene: of a family from the list of tasks, else what the watch began with. */
function sceneOf(watch: WatchState, task: string, signal: AbortSignal): Promise<Scene> {
  const cached = watch.scenes.get(task) ?? loadTask(task, signal).then((t) => t.scene);
  watch.scenes.set(task, cached);
  return cached;
}

function worldFacts(world: World): HTMLElement[] {
  const hidden = h("em", {}, "hidden");
  const latents = world.latents ? Object.entries(world.latents).map(([name, v]) => `${name} ${short(v as number)}`).join(", ") || "the scene's own" : hidden;
  const facts: [string, HTMLElement | string][] = [
    ["Task", world.task],
    ["Current task", world.state.task ?? "none"],
    ["Kind", world.kind === "real" ? "real" : "simulated"],
    ...(world.owner ? [["Owner", world.owner] as [string, string]] : []),
    ["Interactions", h("strong", { class: "count" }, world.budget == null ? String(world.interactions) : `${world.interactions} of ${world.budget}`)],
    ["Episodes", String(world.state.episodes)],
    ["Latents", latents],
  ];
  return [h("dl", { class: "facts" }, ...facts.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]))];
}

function eventRow(event: WorldEvent, pick: () => void): HTMLElement {
  const item = h("li", { value: event.number, "data-what": event.what }, eventText(event), countsInteraction(event) ? h("span", { class: "soft" }, `, interactions ${event.interactions}`) : null);
  if (!event.film) return item;
  const button = h("button", { type: "button", class: "quiet", "aria-label": `Show the film of event ${event.number}` }, "▶");
  button.addEventListener("click", pick);
  item.prepend(button);
  return item;
}

/** Gathers what comes and paints it no more often than one can look. */
function throttled<T>(render: (waiting: T[]) => void, signal: AbortSignal): (one: T | null) => void {
  let [waiting, due, last]: [T[], boolean, number] = [[], false, -MIN_FRAME_INTERVAL_MS];
  const now = (): void => {
    due = false;
    last = performance.now();
    const batch = waiting;
    waiting = [];
    if (!signal.aborted) render(batch);
  };
  return (one) => {
    if (one !== null) waiting.push(one);
    if (due) return;
    due = true;
    setTimeout(now, Math.max(0, last + MIN_FRAME_INTERVAL_MS - performance.now()));
  };
}
