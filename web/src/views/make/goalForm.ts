// The form of the goal: contact, no contact, centre within a region, or above a line.

import { h } from "../../dom";
import { allObjects, type Goal, type Scene } from "../../scene/types";
import { choice, group, nameChoice, number, type Field } from "./formFields";
import type { FormContext, Panel } from "./panel";
import { write } from "./path";
import { corners } from "./objectForm";

const KINDS: readonly [string, string][] = [
  ["", "none"],
  ["contact", "two objects touch"],
  ["apart", "two objects do not touch"],
  ["inside", "a body's centre is in a region"],
  ["above", "a body is above a height"],
];

export function goalPanel(context: FormContext): Panel {
  const { goal } = context.scene();
  const names = allObjects(context.scene()).map((b) => b.name);
  const bodies = context.scene().bodies.map((b) => b.name);
  const type = choice(context, { label: "Goal", path: "goal.type" }, KINDS, (scene) => scene.goal?.type ?? "", (scene, value) => write(scene, "goal", defaultGoal(scene, value)));
  type.element.classList.add("broad");
  const hold = number(context, { label: "Held for", path: "goal.hold_s", unit: "s", empty: "0" });
  const note = h("p", { class: "soft" }, "A world requires a goal and an action space.");
  if (!goal) return { element: h("div", { class: "stack" }, type.element, note), fields: [type] };
  if (goal.type === "contact" || goal.type === "apart") {
    const parts = [
      nameChoice(context, { label: "First object", path: "goal.bodies[0]" }, names),
      nameChoice(context, { label: "Second object", path: "goal.bodies[1]" }, names),
      number(context, { label: "Tolerance", path: "goal.tolerance", unit: "m", empty: "0.0167" }),
      hold,
    ];
    return { element: h("div", { class: "stack" }, type.element, group(goal.type === "contact" ? "Contact" : "Apart", ...parts)), fields: [type, ...parts] };
  }
  const body = nameChoice(context, { label: "Body", path: "goal.body" }, bodies);
  if (goal.type === "above") {
    const line: Field[] = goal.line ? [] : [number(context, { label: "Height", path: "goal.height", unit: "m" })];
    const about = goal.line ? h("p", { class: "soft" }, "The line through two points can only be edited in the file.") : null;
    return { element: h("div", { class: "stack" }, type.element, group("Above", body, ...line, hold), about), fields: [type, body, ...line, hold] };
  }
  const region = corners(context, "goal.region", "Region");
  return { element: h("div", { class: "stack" }, type.element, group("Inside", body, hold), ...region.parts), fields: [type, body, hold, ...region.fields] };
}

/** A default goal of a type, with the first bodies. */
function defaultGoal(scene: Scene, type: string): Goal | undefined {
  const names = [...scene.bodies, ...(scene.statics ?? [])].map((b) => b.name);
  const hold = scene.goal?.hold_s === undefined ? {} : { hold_s: scene.goal.hold_s };
  if (type === "contact") return { type, bodies: [names[0] ?? "", names[1] ?? ""], ...hold };
  if (type === "apart") return { type, bodies: [names[0] ?? "", names[1] ?? ""], ...hold };
  const [x, y] = scene.bodies[0]?.position ?? [0, 0];
  if (type === "above") return { type, body: names[0] ?? "", height: y + 1, ...hold };
  if (type !== "inside") return undefined;
  return { type, body: names[0] ?? "", region: [[x - 1, y - 1], [x + 1, y - 1], [x + 1, y + 1], [x - 1, y + 1]], ...hold };
}
