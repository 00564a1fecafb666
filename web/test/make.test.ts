import assert from "node:assert/strict";
import { test } from "node:test";
import type { Body, Point, Scene } from "../src/scene/types";
import { pretty } from "../src/scene/code";
import { corners } from "../src/scene/extent";
import { applyChange, displayedScene, withDisplayedPose, locationOf, moveObject, initialState, undoChange } from "../src/views/make/editorState";
import { quasiRandomPoint } from "../src/views/make/simulate";
import { withNumber } from "../src/views/make/formFields";
import { placementAreas, dragHandle, handles, hitTest, moveSelection } from "../src/views/make/handles";
import { begin, change, redo, settle, undo } from "../src/views/make/history";
import { affectedFields, read, write } from "../src/views/make/path";
import { convertShape, distanceTo, hull, middle, toWorldFrame, scaled } from "../src/views/make/shapes";
import { curl, filename, python } from "../src/views/make/export";
import { recentred, convertObject, duplicateObject, removeObject, renameObject, objectAt, rotated } from "../src/views/make/objects";
import { drawPolygon, drawShape, drawDefault } from "../src/views/make/tools";

const scene: Scene = {
  format: "iplw.scene/1",
  name: "it's",
  gravity: [0, -9.8],
  bodies: [
    { name: "ball", shape: { type: "disc", radius: 1 }, position: [0, 5] },
    { name: "plank", shape: { type: "box", half_width: 2, half_height: 0.5 }, position: [4, 2], angle: 0.3 },
  ],
  statics: [{ name: "floor", shape: { type: "segment", from: [-10, 0], to: [10, 0] } }],
  goal: { type: "contact", bodies: ["ball", "floor"], hold_s: 1 },
  action: {
    components: [
      { target: "ball", set: "x", low: -1, high: 1 },
      { target: "plank", set: "angle", low: 0, high: 1 },
      { target: "ball", set: "y", low: 4, high: 6 },
    ],
    bounds: [-10, 0, 10, 10],
    discrete: { type: "grid", counts: [3, 4, 5] },
  },
  carriers: ["ball", "floor"],
  settings: { slow: { bodies: { ball: { mass: 0.5 } } } },
  effects: [{ name: "wind", parameters: { ax: 1 } }],
};

function near(a: Point, b: Point, by = 1e-6): void {
  assert.ok(Math.hypot(a[0] - b[0], a[1] - b[1]) <= by, `${a} and ${b}`);
}

test("paths read and write the server's field names, without changing other fields", () => {
  assert.equal(read(scene, "bodies[1].shape.half_width"), 2);
  assert.equal(read(scene, "bodies[7].shape.half_width"), undefined);
  const next = write(scene, "bodies[1].shape.half_width", 3);
  assert.equal(read(next, "bodies[1].shape.half_width"), 3);
  assert.equal(read(scene, "bodies[1].shape.half_width"), 2);
  assert.equal(next.statics, scene.statics);
  assert.deepEqual(Object.keys(write(next, "name", "b")), Object.keys(scene));
  assert.equal("name" in write(scene, "name", undefined), false);
  assert.deepEqual(write(scene, "bodies[0]", undefined).bodies.map((b) => b.name), ["plank"]);
  assert.deepEqual(read(write({}, "action.bounds[0]", 1), "action.bounds"), [1]);
});

test("a problem is assigned to its field, else to those within it, else to the enclosing one", () => {
  const fields = ["bodies[0].position[0]", "bodies[0].position[1]", "bodies[0].shape.type", "bodies[0]", "bodies[01]"];
  assert.deepEqual(affectedFields(fields, "bodies[0].position[1]"), ["bodies[0].position[1]"]);
  assert.deepEqual(affectedFields(fields, "bodies[0].position"), fields.slice(0, 2));
  assert.deepEqual(affectedFields(fields, "bodies[0].mass"), ["bodies[0]"]);
  assert.deepEqual(affectedFields(fields, "goal.body"), []);
  assert.equal(locationOf("bodies[0].mass"), "bodies[0]");
  assert.equal(locationOf("action.components[1].low"), "action");
  assert.equal(locationOf("gravity[0]"), "world");
});

test("changes of one drag are undone together, others one at a time", () => {
  let now = begin(0);
  for (const v of [1, 2, 3]) now = change(now, v, "drag-1");
  now = change(settle(now), 4, "drag-1");
  now = change(now, 5);
  assert.equal(undo(now).present, 4);
  assert.equal(undo(undo(now)).present, 3);
  assert.equal(undo(undo(undo(now))).present, 0);
  assert.equal(undo(undo(undo(undo(now)))).present, 0);
  assert.equal(redo(undo(now)).present, 5);
  assert.equal(redo(change(undo(now), 9)).present, 9);
});

test("references follow renames, and references to deleted objects are removed", () => {
  const other = renameObject(scene, "bodies[0]", "puck") as Scene;
  assert.equal(renameObject(scene, "bodies[0]", "plank"), `Another object is named "plank".`);
  assert.ok(!JSON.stringify(other).includes('"ball"'));
  assert.deepEqual(other.goal, { type: "contact", bodies: ["puck", "floor"], hold_s: 1 });
  assert.deepEqual(other.settings, { slow: { bodies: { puck: { mass: 0.5 } } } });
  const less = removeObject(scene, "bodies[0]");
  assert.ok(!JSON.stringify(less).includes('"ball"'));
  assert.equal(less.goal, undefined);
  assert.deepEqual(less.action!.discrete, { type: "grid", counts: [4] });
  assert.equal(removeObject(less, "bodies[0]").action, undefined);
  assert.deepEqual(less.effects, scene.effects);
  assert.deepEqual(duplicateObject(scene, "bodies[0]", 1).scene.bodies[2], { ...scene.bodies[0], name: "ball 2", position: [1, 6] });
});

test("a body is converted to a static without body-only fields, and back with the required fields", () => {
  const heavy = write(scene, "bodies[0]", { ...scene.bodies[0]!, mass: 2, velocity: [1, 0] });
  const fixed = convertObject(heavy, "bodies[0]");
  assert.equal(fixed.place, "statics[1]");
  assert.deepEqual(objectAt(fixed.scene, "statics[1]"), scene.bodies[0]);
  const loose = convertObject(scene, "statics[0]");
  assert.equal(loose.place, "bodies[2]");
  const { shape } = objectAt(loose.scene, "bodies[2]")!;
  assert.ok(shape.type === "segment" && shape.radius! > 0);
});

test("rotation keeps the centre", () => {
  for (const shape of [scene.statics![0]!.shape, { type: "polygon", vertices: [[0, 0], [2, 0], [1, 3]] } as Body["shape"], scene.bodies[1]!.shape]) {
    const one: Body = { name: "a", shape, position: [3, -1], angle: 0.2 };
    near(toWorldFrame(rotated(one, 2), middle(shape)), toWorldFrame(one, middle(shape)), 1e-5);
    near(toWorldFrame(recentred(one), middle(recentred(one).shape)), toWorldFrame(one, middle(shape)), 1e-5);
  }
});

test("scaling keeps the centre, and scales all parts of compounds", () => {
  const shape: Body["shape"] = {
    type: "compound",
    pieces: [
      { type: "box", half_width: 1, half_height: 2, position: [1, 0], angle: 0.5 },
      { type: "polygon", vertices: [[1, 0], [2, 0], [1, 1]], angle: -1 },
    ],
  };
  const [small, large] = [corners(shape, [0, 0], 0), corners(scaled(shape, 2), [0, 0], 0)];
  large.forEach((p, i) => near(p, [2 * small[i]![0], 2 * small[i]![1]], 1e-5));
  assert.deepEqual(scaled({ type: "segment", from: [1, 1], to: [3, 1] }, 2), { type: "segment", from: [0, 1], to: [4, 1] });
  assert.deepEqual(convertShape({ type: "disc", radius: 2 }, "box"), { type: "box", half_width: 2, half_height: 2 });
});

test("a hull is convex and counter-clockwise for any order of clicks", () => {
  assert.deepEqual(hull([[0, 0], [0, 2], [2, 2], [1, 1], [2, 0], [1, 0], [0, 0]]), [[0, 0], [2, 0], [2, 2], [0, 2]]);
  assert.equal(hull([[0, 0], [1, 1], [2, 2]]).length < 3, true);
  const done = drawPolygon(scene, [[0, 0], [0, 3], [3, 0]], true)!;
  assert.deepEqual(corners(objectAt(done.scene, done.place)!.shape, objectAt(done.scene, done.place)!.position!, 0), [[0, 0], [3, 0], [0, 3]]);
});

test("dragging a corner keeps the opposite one, and dragging a handle rotates to the pointer", () => {
  const before = objectAt(scene, "bodies[1]")!;
  const fixed = toWorldFrame(before, [-2, -0.5]);
  const after = objectAt(dragHandle(scene, "bodies[1]", "2", [8, 5]), "bodies[1]")!;
  const shape = after.shape as { half_width: number; half_height: number };
  near(toWorldFrame(after, [-shape.half_width, -shape.half_height]), fixed, 1e-5);
  near(toWorldFrame(after, [shape.half_width, shape.half_height]), [8, 5], 1e-5);
  assert.equal(objectAt(dragHandle(scene, "bodies[1]", "turn", [0, 2]), "bodies[1]")!.angle, 1.57);
  assert.deepEqual(objectAt(dragHandle(scene, "bodies[0]", "radius", [0, 8]), "bodies[0]")!.shape, { type: "disc", radius: 3 });
  assert.deepEqual(handles(scene, "bodies[0]", 1).map((h) => h.id), ["radius", "turn"]);
});

test("the action region is a rectangle with handles", () => {
  assert.deepEqual(placementAreas(scene).map((a) => a.box), [[-1, 4, 1, 6], [-10, 0, 10, 10]]);
  const wider = dragHandle(scene, "action", "2:ball", [3, 9]);
  assert.deepEqual(placementAreas(wider)[0]!.box, [-1, 4, 3, 9]);
  assert.deepEqual(dragHandle(scene, "action", "0:ball", [3, 9]).action!.components[0], { target: "ball", set: "x", low: 1, high: 1 });
  assert.deepEqual(dragHandle(scene, "action", "move:", [1, 5]).action!.bounds, [-9, 0, 11, 10]);
  assert.deepEqual(placementAreas(moveSelection(scene, "action", [1, 1])).map((a) => a.box), [[0, 5, 2, 7], [-9, 1, 11, 11]]);
});

test("the topmost object is hit, and thin objects within a tolerance", () => {
  assert.equal(hitTest(scene, [0.9, 5], 0.2), "bodies[0]");
  assert.equal(hitTest(scene, [3, 0.1], 0.2), "statics[0]");
  assert.equal(hitTest(scene, [3, 0.5], 0.2), null);
  assert.equal(hitTest(scene, [-1.1, 4.2], 0.2), "action");
  assert.equal(distanceTo({ name: "half", shape: { type: "halfspace", normal: [0, 1], offset: 2 } }, [5, 3]), 1);
});

test("tools create objects from the drag", () => {
  const blank: Scene = { format: "iplw.scene/1", bodies: [] };
  const view: [number, number, number, number] = [-10, -5, 10, 5];
  const draw = (tool: "disc" | "box" | "segment" | "goal" | "area" | "bounds", on = blank, moving = true) => drawShape(on, tool, [1, 1], [3, 2], moving, view, "bodies[0]");
  assert.deepEqual(draw("box")!.scene.bodies, [{ name: "box", shape: { type: "box", half_width: 1, half_height: 0.5 }, position: [2, 1.5] }]);
  const segment = draw("segment", blank, false)!.scene.statics![0]!;
  assert.deepEqual(corners(segment.shape, segment.position!, 0).slice(0, 1), [[1, 1]]);
  assert.equal(draw("area"), null);
  assert.equal(drawShape(blank, "disc", [1, 1], [1, 1], true, view, ""), null);
  const ball = draw("disc")!.scene;
  assert.deepEqual(draw("goal", ball)!.scene.goal, { type: "inside", body: "disc", region: [[1, 1], [3, 1], [3, 2], [1, 2]] });
  assert.deepEqual(draw("area", ball)!.scene.action, { components: [{ target: "disc", set: "x", low: 1, high: 3 }, { target: "disc", set: "y", low: 1, high: 2 }] });
  const grown = draw("area", scene)!.scene.action!;
  assert.deepEqual([grown.components.length, grown.components[0]!.high], [3, 3]);
  assert.equal(drawDefault(blank, "disc", [0, 0], true, view, "", 0.1)!.scene.bodies.length, 1);
});

test("bodies placed by an action are displayed at their action positions, and moved from there", () => {
  const { position: _, ...ball } = scene.bodies[0]!;
  const open = { ...scene, bodies: [ball, scene.bodies[1]!] };
  const state = { ...initialState(open), action: [1, 0.5, 0], selected: "bodies[0]" };
  assert.deepEqual(displayedScene(state).bodies[0]!.position, [1, 4]);
  const base = withDisplayedPose(state, "bodies[0]");
  assert.deepEqual(base.bodies[0]!.position, [1, 4]);
  const after = moveObject(state, moveSelection(base, "bodies[0]", [0, 1]), null);
  assert.equal(after.action, null);
  assert.deepEqual(displayedScene(after).bodies[0]!.position, [1, 5]);
  assert.equal(undoChange(after).history.present, open);
  // A selection of what is gone is none.
  assert.equal(applyChange(state, removeObject(open, "bodies[0]"), null).selected, "bodies[0]");
  assert.equal(applyChange({ ...state, selected: "bodies[1]" }, removeObject(open, "bodies[1]"), null).selected, "world");
});

test("an incomplete pair is completed, and an empty field removes it", () => {
  const option = { label: "x", path: "bodies[0].velocity[0]", empty: "0", pair: [0, 0] as [number, number] };
  const fast = withNumber(scene, option, 3);
  assert.deepEqual(fast.bodies[0]!.velocity, [3, 0]);
  assert.deepEqual(withNumber(fast, { ...option, path: "bodies[0].velocity[1]" }, 4).bodies[0]!.velocity, [3, 4]);
  assert.equal("velocity" in withNumber(fast, option, undefined).bodies[0]!, false);
});

test("a saved scene is unchanged; copied commands are quoted for the shell and Python", () => {
  assert.deepEqual(JSON.parse(pretty(scene)), scene);
  assert.equal(filename(scene), "it-s.json");
  assert.equal(filename({ ...scene, name: "../" }), "scene.json");
  assert.ok(curl(scene, "http://h", false).includes(`"it'\\''s"`));
  assert.ok(!curl(scene, "http://h", false).includes("TOKEN") && curl(scene, "http://h", true).includes("Bearer $IPLW_TOKEN"));
  assert.ok(python(scene, "http://h").includes('"it\'s"'));
});

test("candidate actions cover the cube, its centre first", () => {
  assert.deepEqual(quasiRandomPoint(3, 0), [0.5, 0.5, 0.5]);
  const cells = new Set(Array.from({ length: 200 }, (_, i) => quasiRandomPoint(2, i).map((v) => Math.floor(v * 5)).join()));
  assert.equal(cells.size, 25);
});
