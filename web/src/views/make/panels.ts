// Selects the form for the selection: object, goal, action space, effects, world.

import { h } from "../../dom";
import { allObjects, type Scene } from "../../scene/types";
import { actionPanel } from "./actionForm";
import { choice, group, number, text } from "./formFields";
import { effectsPanel } from "./effectsForm";
import { goalPanel } from "./goalForm";
import type { FormContext, Panel } from "./panel";
import { write } from "./path";
import { objectAt } from "./objects";
import { objectForm } from "./objectForm";

/** The form for a path. */
export function panel(context: FormContext, place: string): Panel {
  const scene = context.scene();
  if (objectAt(scene, place)) return objectForm(context, place);
  if (place === "goal") return goalPanel(context);
  if (place === "action") return actionPanel(context);
  if (place === "effects") return effectsPanel(context, context.library);
  return world(context);
}

/** A key that changes when the form must be rebuilt instead of updated. */
export function formKey(scene: Scene, place: string): string {
  const object = objectAt(scene, place);
  const names = allObjects(scene).map((b) => b.name);
  if (object) {
    const { shape } = object;
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

/** Fields without a form; they are preserved. */
const PRESERVED_FIELDS: Record<string, string> = {
  carriers: "carriers of the latents",
  calibrate: "latents to calibrate",
  per_setting: "quantities per setting",
  settings: "settings",
};

function world(context: FormContext): Panel {
  const name = text(context, { label: "Name", path: "name" }, (scene, value) => write(scene, "name", value === "" ? undefined : value));
  const gravity = [
    number(context, { label: "x", path: "gravity[0]", unit: "m/s²", empty: "0", pair: [0, -9.8] }),
    number(context, { label: "y", path: "gravity[1]", unit: "m/s²", empty: "-9.8", pair: [0, -9.8] }),
  ];
  const time = [
    number(context, { label: "Time step", path: "time_step", unit: "s", empty: "1/240" }),
    number(context, { label: "Steps", path: "steps", empty: "4000" }),
    number(context, { label: "Steps per sample", path: "observe_every", empty: "60" }),
    number(context, { label: "Damping", path: "damping", unit: "1/s", empty: "none" }),
  ];
  const stop = choice(
    context,
    { label: "When the goal is reached", path: "stop" },
    [["true", "stop"], ["false", "continue"]],
    (scene) => String(scene.stop ?? true),
    (scene, value) => write(scene, "stop", value === "true" ? undefined : false),
  );
  stop.element.classList.add("broad");
  const fields = [name, ...gravity, ...time, stop];
  const preserved = Object.entries(PRESERVED_FIELDS).filter(([field]) => context.scene()[field] !== undefined);
  const note = preserved.length ? h("p", { class: "soft" }, `Not editable here: ${preserved.map(([, what]) => what).join(", ")}.`) : h("span", {});
  const element = h("div", { class: "stack" }, name.element, group("Gravity", ...gravity), group("Time and drag", ...time, stop), note);
  return { element, fields };
}
