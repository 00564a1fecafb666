// The form of a body or a static: shape, place, motion, material.

import { h } from "../../dom";
import type { Body, Point, Scene, Shape } from "../../scene/types";
import { type Asked, choice, type Field, group, number, text } from "./form";
import type { Desk, Panel } from "./panels";
import { read, write } from "./path";
import { as } from "./shapes";
import { converted, doubled, moves, removed, renamed, thing } from "./things";

const SHAPES: readonly [Shape["type"], string][] = [
  ["disc", "disc"],
  ["box", "box"],
  ["polygon", "polygon"],
  ["segment", "segment"],
  ["halfspace", "half plane"],
  ["compound", "compound"],
];

export function thingPanel(desk: Desk, place: string): Panel {
  const one = thing(desk.scene(), place)!;
  const moving = moves(place);
  const name = text(desk, { label: "Name", path: `${place}.name` }, (scene, value) => renamed(scene, place, value));
  const kind = choice(desk, { label: "Kind", path: place }, [["bodies", "body"], ["statics", "static"]], () => place.replace(/\[.*/, ""), (scene) => {
    const done = converted(scene, place);
    desk.select(done.place);
    return done.scene;
  });
  const options = SHAPES.filter(([type]) => type === one.shape.type || (type !== "compound" && (!moving || type !== "halfspace")));
  const type = choice(desk, { label: "Shape", path: `${place}.shape.type` }, options, (scene) => thing(scene, place)?.shape.type ?? "", (scene, value) =>
    write(scene, `${place}.shape`, as(thing(scene, place)!.shape, value as Shape["type"])),
  );
  const sizes = shape(desk, place, one);
  const pose = where(desk, place, one, moving);
  const motion = moving
    ? [
        number(desk, { label: "x", path: `${place}.velocity[0]`, unit: "m/s", empty: "0", pair: [0, 0] }),
        number(desk, { label: "y", path: `${place}.velocity[1]`, unit: "m/s", empty: "0", pair: [0, 0] }),
        number(desk, { label: "Spin", path: `${place}.angular_velocity`, unit: "rad/s", empty: "0" }),
      ]
    : [];
  const surface = material(desk, place, moving);
  const fields = [name, kind, type, ...sizes.fields, ...pose, ...motion, ...surface.fields];
  const element = h(
    "div",
    { class: "stack" },
    h("div", { class: "fields" }, name.element, kind.element, type.element),
    ...sizes.parts,
    group("Position", ...pose),
    motion.length ? group("Velocity at the start", ...motion) : null,
    ...surface.parts,
    buttons(desk, place),
  );
  return { element, fields };
}

function shape(desk: Desk, place: string, one: Body): { fields: Field[]; parts: HTMLElement[] } {
  const at = (field: string): string => `${place}.shape.${field}`;
  const plain = (...asked: Asked[]): { fields: Field[]; parts: HTMLElement[] } => {
    const fields = asked.map((a) => number(desk, a));
    return { fields, parts: [group("Size", ...fields)] };
  };
  switch (one.shape.type) {
    case "disc":
      return plain({ label: "Radius", path: at("radius"), unit: "m" });
    case "box":
      return plain({ label: "Half width", path: at("half_width"), unit: "m" }, { label: "Half height", path: at("half_height"), unit: "m" });
    case "segment":
      return plain(
        { label: "From x", path: at("from[0]"), unit: "m" },
        { label: "From y", path: at("from[1]"), unit: "m" },
        { label: "To x", path: at("to[0]"), unit: "m" },
        { label: "To y", path: at("to[1]"), unit: "m" },
        { label: "Radius", path: at("radius"), unit: "m", empty: "0" },
      );
    case "halfspace":
      return plain(
        { label: "Normal x", path: at("normal[0]") },
        { label: "Normal y", path: at("normal[1]") },
        { label: "Offset", path: at("offset"), unit: "m" },
      );
    case "polygon":
      return corners(desk, at("vertices"), "Corners, counter-clockwise");
    case "compound":
      return { fields: [], parts: [h("p", { class: "soft" }, `A compound of ${one.shape.pieces.length} pieces, which are kept as they are; larger and smaller go by + and -.`)] };
  }
}

/** Corners of a polygon or a region: two numbers each, one more, one less. */
export function corners(desk: Desk, path: string, title: string): { fields: Field[]; parts: HTMLElement[] } {
  const list = (scene: Scene): Point[] => read(scene, path) as Point[];
  const count = list(desk.scene()).length;
  const rows = Array.from({ length: count }, (_, i) => {
    const of = `of corner ${i + 1}`;
    const pair = [number(desk, { label: "x", path: `${path}[${i}][0]`, unit: "m", of }), number(desk, { label: "y", path: `${path}[${i}][1]`, unit: "m", of })];
    const gone = h("button", { type: "button", class: "quiet", "aria-label": `Remove corner ${i + 1}`, disabled: count <= 3 }, "×");
    gone.addEventListener("click", () => desk.change(write(desk.scene(), `${path}[${i}]`, undefined), null));
    return { pair, row: h("div", { class: "corner" }, ...pair.map((f) => f.element), gone) };
  });
  const more = h("button", { type: "button" }, "Add a corner");
  more.addEventListener("click", () => {
    const now = list(desk.scene());
    const [last, first] = [now.at(-1)!, now[0]!];
    // A little outside the middle of the last side, so that a convex polygon stays one.
    const [x, y] = [(last[0] + first[0]) / 2, (last[1] + first[1]) / 2];
    const out: Point = [x + (first[1] - last[1]) / 8, y - (first[0] - last[0]) / 8];
    desk.change(write(desk.scene(), path, [...now, out]), null);
  });
  return { fields: rows.flatMap((r) => r.pair), parts: [h("fieldset", { class: "stack corners" }, h("legend", {}, title), ...rows.map((r) => r.row), more)] };
}

function where(desk: Desk, place: string, one: Body, moving: boolean): Field[] {
  if (one.shape.type === "halfspace") return [number(desk, { label: "Angle", path: `${place}.angle`, unit: "rad", empty: "0" })];
  const empty = moving ? "the action's" : "0";
  return [
    number(desk, { label: "x", path: `${place}.position[0]`, unit: "m", empty, pair: [0, 0] }),
    number(desk, { label: "y", path: `${place}.position[1]`, unit: "m", empty, pair: [0, 0] }),
    number(desk, { label: "Angle", path: `${place}.angle`, unit: "rad", empty: "0" }),
  ];
}

function material(desk: Desk, place: string, moving: boolean): { fields: Field[]; parts: HTMLElement[] } {
  const usual = moving ? "0.5" : "1";
  const surface = [
    number(desk, { label: "Friction", path: `${place}.friction`, empty: usual }),
    number(desk, { label: "Restitution", path: `${place}.restitution`, empty: usual }),
  ];
  if (!moving) return { fields: surface, parts: [group("Surface", ...surface)] };
  const mass = [
    number(desk, { label: "Density", path: `${place}.density`, unit: "kg/m²", empty: "1" }),
    number(desk, { label: "Mass", path: `${place}.mass`, unit: "kg", empty: "auto" }),
  ];
  return { fields: [...mass, ...surface], parts: [group("Density, or mass", ...mass), group("Surface", ...surface)] };
}

function buttons(desk: Desk, place: string): HTMLElement {
  const [again, gone] = [h("button", { type: "button" }, "Duplicate"), h("button", { type: "button" }, "Delete")];
  again.addEventListener("click", () => {
    const done = doubled(desk.scene(), place, 0.5);
    desk.change(done.scene, null);
    desk.select(done.place);
  });
  gone.addEventListener("click", () => {
    desk.change(removed(desk.scene(), place), null);
    desk.select("world");
  });
  return h("div", { class: "row" }, again, gone);
}
