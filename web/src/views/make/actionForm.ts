// The form of the action space: components with ranges, bounds, discretisation.

import { h } from "../../dom";
import { unit } from "../../scene/action";
import { type Component, allObjects, type Scene } from "../../scene/types";
import { choice, type Field, group, nameChoice, number } from "./formFields";
import type { FormContext, Panel } from "./panel";
import { write } from "./path";
import { round } from "./shapes";
import { setComponents } from "./objects";
import { withComponent } from "./tools";

const SETS: readonly Component["set"][] = ["x", "y", "radius", "angle", "vx", "vy", "omega"];

export function actionPanel(context: FormContext): Panel {
  const { action } = context.scene();
  const addButton = h("button", { type: "button", disabled: !allObjects(context.scene()).length }, "Add a component");
  addButton.addEventListener("click", () => context.change(addComponent(context.scene()), null));
  if (!action) {
    const note = h("p", { class: "soft" }, "There is no action. Choose the tool Action area and drag the area where the selected object may be placed, or add a component.");
    return { element: h("div", { class: "stack" }, note, h("div", { class: "row" }, addButton)), fields: [] };
  }
  const rows = action.components.map((_, i) => component(context, i));
  const [limits, discrete] = [bounds(context), discretised(context)];
  const element = h("div", { class: "stack" }, ...rows.map((r) => r.element), h("div", { class: "row" }, addButton), limits.element, discrete.element);
  return { element, fields: [...rows, limits, discrete].flatMap((p) => p.fields) };
}

function component(context: FormContext, index: number): Panel {
  const path = `action.components[${index}]`;
  const of = `of component ${index + 1}`;
  const names = allObjects(context.scene()).map((b) => b.name);
  const at = (scene: Scene): Component | undefined => scene.action?.components[index];
  const set = at(context.scene())!.set;
  const fields = [
    nameChoice(context, { label: "Object", path: `${path}.target`, of }, names),
    choice(context, { label: "Sets", path: `${path}.set`, of }, SETS.map((s) => [s, s]), (scene) => at(scene)?.set ?? "", (scene, value) =>
      write(scene, path, withDefaultRange(scene, { ...at(scene)!, set: value as Component["set"] })),
    ),
    number(context, { label: "Low", path: `${path}.low`, of }),
    number(context, { label: "High", path: `${path}.high`, of }),
  ];
  const removeButton = h("button", { type: "button", class: "quiet", "aria-label": `Remove component ${index + 1}` }, "×");
  removeButton.addEventListener("click", () => {
    const scene = context.scene();
    context.change(setComponents(scene, scene.action!.components.map((c, i) => (i === index ? null : c))), null);
  });
  const element = h("fieldset", { class: "fields component" }, h("legend", {}, `Component ${index + 1}, ${unit({ set } as Component)}`), ...fields.map((f) => f.element), removeButton);
  return { element, fields };
}

function bounds(context: FormContext): Panel {
  const current = context.scene().action?.bounds;
  const button = h("button", { type: "button" }, current ? "No bounds" : "Add bounds");
  button.addEventListener("click", () => context.change(write(context.scene(), "action.bounds", current ? undefined : boundingBox(context.scene())), null));
  if (!Array.isArray(current)) return { element: h("div", { class: "row" }, button), fields: [] };
  const fields = ["Left", "Bottom", "Right", "Top"].map((label, i) => number(context, { label, path: `action.bounds[${i}]`, unit: "m" }));
  return { element: group("Bounds of the action", ...fields, button), fields };
}

function discretised(context: FormContext): Panel {
  const now = context.scene().action?.discrete;
  const type = choice(
    context,
    { label: "Numbered actions", path: "action.discrete.type" },
    [["", "default: 10000"], ["sequence", "a sequence"], ["grid", "a grid"]],
    (scene) => scene.action?.discrete?.type ?? "",
    (scene, value) => write(scene, "action.discrete", discrete(scene, value)),
  );
  type.element.classList.add("broad");
  const counts: Field[] =
    now?.type === "sequence"
      ? [number(context, { label: "Count", path: "action.discrete.count" })]
      : now?.type === "grid"
        ? now.counts.map((_, i) => number(context, { label: "Cells", path: `action.discrete.counts[${i}]`, of: `along component ${i + 1}` }))
        : [];
  return { element: group("Discretised", type, ...counts), fields: [type, ...counts] };
}

function discrete(scene: Scene, type: string): unknown {
  if (type === "sequence") return { type, count: 10_000 };
  return type === "grid" ? { type, counts: scene.action!.components.map(() => 10) } : undefined;
}

/** Adds a component: the next quantity of the last target. */
function addComponent(scene: Scene): Scene {
  const list = scene.action?.components ?? [];
  const target = list.at(-1)?.target ?? allObjects(scene)[0]?.name;
  if (target === undefined) return scene;
  const existing = list.filter((c) => c.target === target).map((c) => c.set);
  const one = allObjects(scene).find((b) => b.name === target);
  const quantity = SETS.filter((s) => (s !== "radius" || one?.shape.type === "disc") && !existing.includes(s))[0] ?? "x";
  return withComponent(scene, withDefaultRange(scene, { target, set: quantity, low: 0, high: 1 }));
}

/** A component with a default range around the object's current value. */
function withDefaultRange(scene: Scene, one: Component): Component {
  const target = allObjects(scene).find((b) => b.name === one.target);
  const [x, y] = target?.position ?? [0, 0];
  const radius = target?.shape.type === "disc" ? target.shape.radius : 1;
  const ranges: Record<Component["set"], [number, number]> = {
    x: [x - 1, x + 1],
    y: [y - 1, y + 1],
    radius: [radius / 2, 2 * radius],
    angle: [-Math.PI, Math.PI],
    vx: [-5, 5],
    vy: [-5, 5],
    omega: [-5, 5],
  };
  const [low, high] = ranges[one.set];
  return { ...one, low: round(low), high: round(high) };
}

/** The bounding box of all placements. */
function boundingBox(scene: Scene): number[] {
  const of = (set: string): number[] => (scene.action?.components ?? []).filter((c) => c.set === set).flatMap((c) => [c.low, c.high]);
  const at = allObjects(scene).flatMap((b) => (b.position ? [b.position] : []));
  const [x, y] = [[...of("x"), ...at.map((p) => p[0]), -1, 1], [...of("y"), ...at.map((p) => p[1]), -1, 1]];
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)].map(round);
}

