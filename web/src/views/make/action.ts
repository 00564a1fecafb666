// The form of the action space: what an action sets, between which values, and the discretised actions.

import { h } from "../../dom";
import { unit } from "../../scene/action";
import { type Component, allObjects, type Scene } from "../../scene/types";
import { choice, type Field, group, named, number } from "./form";
import type { Desk, Panel } from "./panels";
import { write } from "./path";
import { round } from "./shapes";
import { components } from "./things";
import { withComponent } from "./tools";

const SETS: readonly Component["set"][] = ["x", "y", "radius", "angle", "vx", "vy", "omega"];

export function actionPanel(desk: Desk): Panel {
  const { action } = desk.scene();
  const more = h("button", { type: "button", disabled: !allObjects(desk.scene()).length }, "Add a component");
  more.addEventListener("click", () => desk.change(another(desk.scene()), null));
  if (!action) {
    const note = h("p", { class: "soft" }, "Nothing is placed. Choose the tool Action area and drag where the selected thing may be placed, or add a component.");
    return { element: h("div", { class: "stack" }, note, h("div", { class: "row" }, more)), fields: [] };
  }
  const rows = action.components.map((_, i) => component(desk, i));
  const [limits, discrete] = [bounds(desk), discretised(desk)];
  const element = h("div", { class: "stack" }, ...rows.map((r) => r.element), h("div", { class: "row" }, more), limits.element, discrete.element);
  return { element, fields: [...rows, limits, discrete].flatMap((p) => p.fields) };
}

function component(desk: Desk, index: number): Panel {
  const path = `action.components[${index}]`;
  const of = `of component ${index + 1}`;
  const names = allObjects(desk.scene()).map((b) => b.name);
  const at = (scene: Scene): Component | undefined => scene.action?.components[index];
  const set = at(desk.scene())!.set;
  const fields = [
    named(desk, { label: "Thing", path: `${path}.target`, of }, names),
    choice(desk, { label: "Sets", path: `${path}.set`, of }, SETS.map((s) => [s, s]), (scene) => at(scene)?.set ?? "", (scene, value) =>
      write(scene, path, ranged(scene, { ...at(scene)!, set: value as Component["set"] })),
    ),
    number(desk, { label: "Low", path: `${path}.low`, of }),
    number(desk, { label: "High", path: `${path}.high`, of }),
  ];
  const gone = h("button", { type: "button", class: "quiet", "aria-label": `Remove component ${index + 1}` }, "×");
  gone.addEventListener("click", () => {
    const scene = desk.scene();
    desk.change(components(scene, scene.action!.components.map((c, i) => (i === index ? null : c))), null);
  });
  const element = h("fieldset", { class: "fields component" }, h("legend", {}, `Component ${index + 1}, ${unit({ set } as Component)}`), ...fields.map((f) => f.element), gone);
  return { element, fields };
}

function bounds(desk: Desk): Panel {
  const given = desk.scene().action?.bounds;
  const button = h("button", { type: "button" }, given ? "No bounds" : "Add bounds");
  button.addEventListener("click", () => desk.change(write(desk.scene(), "action.bounds", given ? undefined : around(desk.scene())), null));
  if (!Array.isArray(given)) return { element: h("div", { class: "row" }, button), fields: [] };
  const fields = ["Left", "Bottom", "Right", "Top"].map((label, i) => number(desk, { label, path: `action.bounds[${i}]`, unit: "m" }));
  return { element: group("Bounds that nothing placed may leave", ...fields, button), fields };
}

function discretised(desk: Desk): Panel {
  const now = desk.scene().action?.discrete;
  const type = choice(
    desk,
    { label: "Numbered actions", path: "action.discrete.type" },
    [["", "the usual 10000"], ["sequence", "a sequence"], ["grid", "a grid"]],
    (scene) => scene.action?.discrete?.type ?? "",
    (scene, value) => write(scene, "action.discrete", discrete(scene, value)),
  );
  type.element.classList.add("broad");
  const counts: Field[] =
    now?.type === "sequence"
      ? [number(desk, { label: "How many", path: "action.discrete.count" })]
      : now?.type === "grid"
        ? now.counts.map((_, i) => number(desk, { label: "Cells", path: `action.discrete.counts[${i}]`, of: `along component ${i + 1}` }))
        : [];
  return { element: group("Discretised", type, ...counts), fields: [type, ...counts] };
}

function discrete(scene: Scene, type: string): unknown {
  if (type === "sequence") return { type, count: 10_000 };
  return type === "grid" ? { type, counts: scene.action!.components.map(() => 10) } : undefined;
}

/** One component more: what is not yet set of the first thing that something is set of. */
function another(scene: Scene): Scene {
  const list = scene.action?.components ?? [];
  const target = list.at(-1)?.target ?? allObjects(scene)[0]?.name;
  if (target === undefined) return scene;
  const known = list.filter((c) => c.target === target).map((c) => c.set);
  const one = allObjects(scene).find((b) => b.name === target);
  const wanted = SETS.filter((s) => (s !== "radius" || one?.shape.type === "disc") && !known.includes(s))[0] ?? "x";
  return withComponent(scene, ranged(scene, { target, set: wanted, low: 0, high: 1 }));
}

/** A component with values about what the thing has now. */
function ranged(scene: Scene, one: Component): Component {
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

/** A box about all that components place. */
function around(scene: Scene): number[] {
  const of = (set: string): number[] => (scene.action?.components ?? []).filter((c) => c.set === set).flatMap((c) => [c.low, c.high]);
  const at = allObjects(scene).flatMap((b) => (b.position ? [b.position] : []));
  const [x, y] = [[...of("x"), ...at.map((p) => p[0]), -1, 1], [...of("y"), ...at.map((p) => p[1]), -1, 1]];
  return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)].map(round);
}

