// One world with its events and the film of what was observed.

import { ok, api, type Schema } from "../../api/client";
import { follow } from "../../api/events";
import { uniqueId, h, put } from "../../dom";
import { short } from "../../parts/slider";
import type { Film } from "../../scene/film";
import type { Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { loadTask } from "../play/taskPicker";
import { episodeLog } from "./episodes";
import { allowsExample, playExample } from "./example";
import { filmPlayer, type FilmPlayer } from "./filmPlayer";
import { guide } from "./guide";
import { learningCurve } from "./learningCurve";
import { applyEvent, type WorldEvent, eventText, countsInteraction, verdict, waitingFor, type World } from "./messages";

/** Number of events listed. */
const MAX_EVENTS_LISTED = 50;
/** Minimum time between two updates, ms. */
const MIN_FRAME_INTERVAL_MS = 150;

/** State of the watched world. */
interface WatchState {
  world: World;
  /** Scenes by task, read once. */
  scenes: Map<string, Promise<Scene>>;
  missed: number;
  last: number;
}

export async function worldView(place: HTMLElement, id: string, context: Context): Promise<void> {
  const { signal } = context;
  const path = { id };
  // Without permission this request fails, before the event stream is opened.
  const watch: WatchState = { world: await ok(api.GET("/v1/worlds/{id}", { params: { path }, signal })), scenes: new Map(), missed: 0, last: 0 };
  const [facts, front] = [h("div"), h("div", { class: "front" })];
  const log = h("ol", { class: "happened", reversed: true, "aria-label": "Events, newest first" });
  const noEvents = h("p", { class: "soft" }, "No events yet. Steps of a program appear here.");
  const status = h("p", { class: "soft", role: "status" }, "Connecting …");
  const box = uniqueId("follow");
  const newest = h("input", { id: box, type: "checkbox", checked: true });
  const head = h("section", { class: "card stack", "aria-label": "World" }, h("p", {}, h("a", { href: link("live") }, "All worlds")), h("h2", {}, id), facts);
  const events = h("section", { class: "card stack", "aria-label": "Events" }, h("h2", {}, "Events"), status, h("div", { class: "row" }, newest, h("label", { for: box }, "Show the newest film automatically")), noEvents, log);
  const [episodes, curve, start] = [episodeLog(watch.world.max_attempts), learningCurve(), exampleStart(watch.world, context)];
  const help = h("section", { class: "card stack", "aria-label": "Act in this world" }, h("h2", {}, "Act in this world"), guide({ id, dimension: watch.world.action_space.dimension }, start.button));
  put(place, h("div", { class: "live-body" }, h("div", { class: "stack" }, front, curve.element, help), h("div", { class: "stack" }, head, events)));
  let current: { task: string; screen: FilmPlayer } | null = null;
  const playerFor = async (task: string): Promise<FilmPlayer> => {
    if (current?.task !== task) {
      const scene = await sceneOf(watch, task, signal);
      current = { task, screen: filmPlayer(scene, `Scene of ${task} in ${id}`, context) };
      put(front, current.screen.element);
    }
    return current.screen;
  };
  const show = async (event: WorldEvent): Promise<void> => {
    if (!event.task) return;
    const at = await playerFor(event.task);
    if (event.what === "reset") at.empty("The episode has started: waiting for an action.");
    else at.show(event.action ?? [], event.film ? (event.film as unknown as Film) : null, verdict(event));
  };
  const render = throttled((waiting: WorldEvent[]) => {
    put(facts, ...worldFacts(watch.world));
    const rows = waiting.slice(-MAX_EVENTS_LISTED).reverse().map((event) => eventRow(event, () => ((newest.checked = false), void show(event).catch(context.fail))));
    log.prepend(...rows);
    while (log.childElementCount > MAX_EVENTS_LISTED) log.lastElementChild!.remove();
    noEvents.hidden = log.childElementCount > 0;
    help.hidden = noEvents.hidden;
    curve.show(episodes.episodes());
    put(status, watch.missed ? `Watching. ${watch.missed} events were too fast to be displayed.` : "Watching.");
    const last = waiting.filter((e) => e.what === "reset" || e.what === "step" || e.film).at(-1);
    if (last && newest.checked) show(last).catch(context.fail);
  }, signal);
  const onEvent = (data: string, name: string): void => {
    if (name === "world") {
      const first = JSON.parse(data) as Schema<"WatchStart">;
      watch.world = first.world;
      watch.scenes.set(first.task, Promise.resolve(first.scene as unknown as Scene));
      if (!current) void playerFor(first.task).then((s) => s.empty(waitingFor(first.world))).catch(context.fail);
      render(null);
      start.connected();
      return;
    }
    const event = JSON.parse(data) as WorldEvent;
    if (watch.last && event.number > watch.last + 1) watch.missed += event.number - watch.last - 1;
    watch.last = event.number;
    episodes.add(event);
    watch.world = applyEvent(watch.world, event);
    render(event);
  };
  await follow(`/v1/worlds/${encodeURIComponent(id)}/events`, (e) => onEvent(e.data, e.event), signal, "gone");
  if (!signal.aborted) put(status, "The world was deleted, on request or because it was idle.");
}

/** The button that starts an example, where one is allowed; `#/live/w1?example=1` starts it when the page watches. */
function exampleStart(world: World, context: Context): { button: HTMLElement | null; connected: () => void } {
  const button = h("button", { type: "button", class: "main" }, "Play an example");
  let waits = context.query.has("example");
  const play = (): void => {
    button.disabled = true;
    playExample(world, context.signal)
      .catch(context.fail)
      .finally(() => (button.disabled = false));
  };
  button.addEventListener("click", play);
  const connected = (): void => {
    if (!waits || !allowsExample(world)) return;
    waits = false;
    // A reload does not play it again.
    history.replaceState(null, "", link("live", [world.id]));
    play();
  };
  return { button: allowsExample(world) ? button : null, connected };
}

/** A task's scene, from the list of tasks or from the first event. */
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

/** Collects items and renders them at most every `MIN_FRAME_INTERVAL_MS`. */
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
