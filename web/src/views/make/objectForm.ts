// The form of a body or static: shape, pose, motion, material.

import { h } from "../../dom";
import type { Body, Point, Scene, Shape } from "../../scene/types";
import { type FieldSpec, choice, type Field, group, number, text } from "./formFields";
import type { FormContext, Panel } from "./panel";
import { read, write } from "./path";
import { convertShape } from "./shapes";
import { convertObject, duplicateObject, isBody, removeObject, renameObject, objectAt } from "./objects";

const SHAPES: readonly [Shape["type"], string][] = [
  ["disc", "disc"],
  ["box", "box"],
  ["polygon", "polygon"],
  ["segment", "segment"],
  ["halfspace", "half plane"],
  ["compound", "compound"],
];

export function objectForm(context: FormContext, place: string): Panel {
  const object = objectAt(context.scene(), place)!;
  const moving = isBody(place);
  const name = text(context, { label: "Name", path: `${place}.name` }, (scene, value) => renameObject(scene, place, value));
  const kind = choice(context, { label: "Kind", path: place }, [["bodies", "body"], ["statics", "static"]], () => place.replace(/\[.*/, ""), (scene) => {
    const done = convertObject(scene, place);
    context.select(done.place);
    return done.scene;
  });
  const options = SHAPES.filter(([type]) => type === object.shape.type || (type !== "compound" && (!moving || type !== "halfspace")));
  const type = choice(context, { label: "Shape", path: `${place}.shape.type` }, options, (scene) => objectAt(scene, place)?.shape.type ?? "", (scene, value) =>
    write(scene, `${place}.shape`, convertShape(objectAt(scene, place)!.shape, value as Shape["type"])),
  );
  const sizes = shape(context, place, object);
  const pose = poseFields(context, place, object, moving);
  const motion = moving
    ? [
        number(context, { label: "x", path: `${place}.velocity[0]`, unit: "m/s", empty: "0", pair: [0, 0] }),
        number(context, { label: "y", path: `${place}.velocity[1]`, unit: "m/s", empty: "0", pair: [0, 0] }),
        number(context, { label: "Spin", path: `${place}.angular_velocity`, unit: "rad/s", empty: "0" }),
      ]
    : [];
  const surface = material(context, place, moving);
  const fields = [name, kind, type, ...sizes.fields, ...pose, ...motion, ...surface.fields];
  const element = h(
    "div",
    { class: "stack" },
    h("div", { class: "fields" }, name.element, kind.element, type.element),
    ...sizes.parts,
    group("Position", ...pose),
    motion.length ? group("Velocity at the start", ...motion) : null,
    ...surface.parts,
    buttons(context, place),
  );
  return { element, fields };
}

function shape(context: FormContext, place: string, object: Body): { fields: Field[]; parts: HTMLElement[] } {
  const at = (field: string): string => `${place}.shape.${field}`;
  const numberFields = (...specs: FieldSpec[]): { fields: Field[]; parts: HTMLElement[] } => {
    const fields = specs.map((a) => number(context, a));
    return { fields, parts: [group("Size", ...fields)] };
  };
  switch (object.shape.type) {
    case "disc":
      return numberFields({ label: "Radius", path: at("radius"), unit: "m" });
    case "box":
      return numberFields({ label: "Half width", path: at("half_width"), unit: "m" }, { label: "Half height", path: at("half_height"), unit: "m" });
    case "segment":
      return numberFields(
        { label: "From x", path: at("from[0]"), unit: "m" },
        { label: "From y", path: at("from[1]"), unit: "m" },
        { label: "To x", path: at("to[0]"), unit: "m" },
        { label: "To y", path: at("to[1]"), unit: "m" },
        { label: "Radius", path: at("radius"), unit: "m", empty: "0" },
      );
    case "halfspace":
      return numberFields(
        { label: "Normal x", path: at("normal[0]") },
        { label: "Normal y", path: at("normal[1]") },
        { label: "Offset", path: at("offset"), unit: "m" },
      );
    case "polygon":
      return corners(context, at("vertices"), "Corners, counter-clockwise");
    case "compound":
      return { fields: [], parts: [h("p", { class: "soft" }, `A compound of ${object.shape.pieces.length} pieces, which cannot be edited; + and - change its size.`)] };
  }
}

/** Vertices of a polygon or region: two numbers each, with buttons to add and remove. */
export function corners(context: FormContext, path: string, title: string): { fields: Field[]; parts: HTMLElement[] } {
  const list = (scene: Scene): Point[] => read(scene, path) as Point[];
  const count = list(context.scene()).length;
  const rows = Array.from({ length: count }, (_, i) => {
    const of = `of corner ${i + 1}`;
    const pair = [number(context, { label: "x", path: `${path}[${i}][0]`, unit: "m", of }), number(context, { label: "y", path: `${path}[${i}][1]`, unit: "m", of })];
    const removeButton = h("button", { type: "button", class: "quiet", "aria-label": `Remove corner ${i + 1}`, disabled: count <= 3 }, "×");
    removeButton.addEventListener("click", () => context.change(write(context.scene(), `${path}[${i}]`, undefined), null));
    return { pair, row: h("div", { class: "corner" }, ...pair.map((f) => f.element), removeButton) };
  });
  const more = h("button", { type: "button" }, "Add a corner");
  more.addEventListener("click", () => {
    const now = list(context.scene());
    const [last, first] = [now.at(-1)!, now[0]!];
    // Slightly outside the middle of the last edge, so that a convex polygon remains convex.
    const [x, y] = [(last[0] + first[0]) / 2, (last[1] + first[1]) / 2];
    const out: Point = [x + (first[1] - last[1]) / 8, y - (first[0] - last[0]) / 8];
    context.change(write(context.scene(), path, [...now, out]), null);
  });
  return { fields: rows.flatMap((r) => r.pair), parts: [h("fieldset", { class: "stack corners" }, h("legend", {}, title), ...rows.map((r) => r.row), more)] };
}

function poseFields(context: FormContext, place: string, object: Body, moving: boolean): Field[] {
  if (object.shape.type === "halfspace") return [number(context, { label: "Angle", path: `${place}.angle`, unit: "rad", empty: "0" })];
  const empty = moving ? "the action's" : "0";
  return [
    number(context, { label: "x", path: `${place}.position[0]`, unit: "m", empty, pair: [0, 0] }),
    number(context, { label: "y", path: `${place}.position[1]`, unit: "m", empty, pair: [0, 0] }),
    number(context, { label: "Angle", path: `${place}.angle`, unit: "rad", empty: "0" }),
  ];
}

function material(context: FormContext, place: string, moving: boolean): { fields: Field[]; parts: HTMLElement[] } {
  const defaultValue = moving ? "0.5" : "1";
  const surface = [
    number(context, { label: "Friction", path: `${place}.friction`, empty: defaultValue }),
    number(context, { label: "Restitution", path: `${place}.restitution`, empty: defaultValue }),
  ];
  if (!moving) return { fields: surface, parts: [group("Surface", ...surface)] };
  const mass = [
    number(context, { label: "Density", path: `${place}.density`, unit: "kg/m²", empty: "1" }),
    number(context, { label: "Mass", path: `${place}.mass`, unit: "kg", empty: "auto" }),
  ];
  return { fields: [...mass, ...surface], parts: [group("Density, or mass", ...mass), group("Surface", ...surface)] };
}

function buttons(context: FormContext, place: string): HTMLElement {
  const [duplicate, removeButton] = [h("button", { type: "button" }, "Duplicate"), h("button", { type: "button" }, "Delete")];
  duplicate.addEventListener("click", () => {
    const done = duplicateObject(context.scene(), place, 0.5);
    context.change(done.scene, null);
    context.select(done.place);
  });
  removeButton.addEventListener("click", () => {
    context.change(removeObject(context.scene(), place), null);
    context.select("world");
  });
  return h("div", { class: "row" }, duplicate, removeButton);
}
