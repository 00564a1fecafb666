// Texts of world events, and the world after an event.

import type { Schema } from "../../api/client";
import { short } from "../../parts/slider";

export type World = Schema<"WorldOut">;
export type WorldEvent = Schema<"WorldEventOut">;

/** The world after an event, as far as the event describes it. */
export function applyEvent(world: World, event: WorldEvent): World {
  const state = { ...world.state };
  if (event.what === "reset") [state.task, state.phase, state.episodes] = [event.task ?? null, "ready", state.episodes + 1];
  if (event.what === "step" && event.valid) state.phase = "done";
  const remaining = world.budget == null ? null : Math.max(0, world.budget - event.interactions);
  return { ...world, state, interactions: event.interactions, remaining, ...(event.latents ? { latents: event.latents } : {}) };
}

/** Text of the next expected event. */
export function waitingFor(world: World): string {
  return { new: "No episode has started.", ready: "Waiting for an action.", done: "The episode has ended." }[world.state.phase] ?? "";
}

/** Outcome of an action; empty for attempts outside the episode. */
export function verdict(event: WorldEvent): string {
  if (event.what === "attempts") return "";
  if (!event.valid) return `not placed: ${event.reason ?? ""}`;
  if (event.end === "diverged") return "diverged";
  return event.solved ? "solved" : "not solved";
}

/** One-line text of an event. */
export function eventText(event: WorldEvent): string {
  const at = event.action ? ` at ${event.action.map((v) => v.toFixed(3)).join(", ")}` : "";
  switch (event.what) {
    case "reset":
      return `Reset to ${event.task}`;
    case "step":
      return `Step${at}: ${verdict(event)}`;
    case "attempts": {
      const { tried, valid, solved } = event.attempts ?? { tried: 0, valid: 0, solved: 0 };
      return `${tried} ${tried === 1 ? "attempt" : "attempts"} on ${event.task}: ${valid} placed, ${solved} solved`;
    }
    case "latents":
      return `Latents set: ${Object.entries(event.latents ?? {}).map(([name, v]) => `${name} ${short(v as number)}`).join(", ")}`;
    default:
      return "The world was deleted";
  }
}

/** Whether the event counts as an interaction. */
export function countsInteraction(event: WorldEvent): boolean {
  return event.what === "attempts" || (event.what === "step" && event.valid === true);
}
