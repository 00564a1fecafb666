// What the form shows of what is selected: a thing, the goal, the action space, the world.

import { h } from "../../dom";
import { allObjects, type Scene } from "../../scene/types";
import { actionPanel } from "./action";
import { type Draft, type Field, choice, group, number, text } from "./form";
import { effectsPanel, type Library } from "./effects";
import { goalPanel } from "./goal";
import { write } from "./path";
import { thing } from "./things";
import { thingPanel } from "./thing";

export interface Panel {
  element: HTMLElement;
  fields: Field[];
}

/** What a form needs beyond the draft: another selection, since a thing may move to another list, and the effects there are. */
export interface Desk extends Draft {
  select: (place: string) => void;
  /** The server's effects. */
  library: Library;
}

/** The form of what is at a place. */
export function panel(desk: Desk, place: string): Panel {
  const scene = desk.scene();
  if (thing(scene, place)) return thingPanel(desk, place);
  if (place === "goal") return goalPanel(desk);
  if (place === "action") return actionPanel(desk);
  if (place === "effects") return effectsPanel(desk, desk.library);
  return world(desk);
}

/** Changes where the form has to be made anew, and not only filled again. */
export function kind(scene: Scene, place: string): string {
  const one = thing(scene, place);
  const names = allObjects(scene).map((b) => b.name);
  if (one) {
    const { shape } = one;
    const parts = shape.type === "polygon" ? shape.vertices.length : shape.type === "compound" ? shape.pieces.length : 0;
    return JSON.stringify([place, shape.type, parts]);
  }
  if (place === "goal") return JSON.stringify([place, scene.goal?.type, scene.goal?.type === "inside" ? scene.goal.region.length : 0, names]);
  if (place === "action") {
    const { action } = scene;
    const { discrete } = action ?? {};
    const counts = discrete?.type === "grid" ? discrete.counts.length : 0;
    return JSON.stringify([place, action?.components.map((c) => c.set), Boolean(action?.bounds), discrete?.type, counts, names]);
  }
  if (place === "effects") return JSON.stringify([place, (scene.effects as { name: string }[] | undefined)?.map((e) => e.name)]);
  return place;
}

/** Fields of the format that have no form here: they are kept as they are. */
const UNTOUCHED: Record<string, string> = {
  carriers: "carriers of the latents",
  calibrate: "latents to calibrate",
  per_setting: "quantities per setting",
  settings: "settings",
};

function world(desk: Desk): Panel {
  const name = text(desk, { label: "Name", path: "name" }, (scene, value) => write(scene, "name", value === "" ? undefined : value));
  const gravity = [
    number(desk, { label: "x", path: "gravity[0]", unit: "m/s²", empty: "0", pair: [0, -9.8] }),
    number(desk, { label: "y", path: "gravity[1]", unit: "m/s²", empty: "-9.8", pair: [0, -9.8] }),
  ];
  const time = [
    number(desk, { label: "Time step", path: "time_step", unit: "s", empty: "1/240" }),
    number(desk, { label: "Steps", path: "steps", empty: "4000" }),
    number(desk, { label: "Steps a sample", path: "observe_every", empty: "60" }),
    number(desk, { label: "Damping", path: "damping", unit: "kept/s", empty: "none" }),
  ];
  const stop = choice(
    desk,
    { label: "When the goal is reached", path: "stop" },
    [["true", "it ends"], ["false", "it goes on"]],
    (scene) => String(scene.stop ?? true),
    (scene, value) => write(scene, "stop", value === "true" ? undefined : false),
  );
  stop.element.classList.add("broad");
  const fields = [name, ...gravity, ...time, stop];
  const kept = Object.entries(UNTOUCHED).filter(([field]) => desk.scene()[field] !== undefined);
  const note = kept.length ? h("p", { class: "soft" }, `Kept as they are: ${kept.map(([, what]) => what).join(", ")}.`) : h("span", {});
  const element = h("div", { class: "stack" }, name.element, group("Gravity", ...gravity), group("Time and drag", ...time, stop), note);
  return { element, fields };
}
