import assert from "node:assert/strict";
import { test } from "node:test";
import { type Mechanism, mechanismOf, poses, reach } from "../src/views/joints/mechanism";
import { parseRecording, positionsAt } from "../src/views/joints/recording";

/** A cart on a rail, with a pole whose centre hangs half a metre below. */
const CART: Mechanism = {
  bodies: [
    { name: "cart", shape: { type: "box", half_width: 0.2, half_height: 0.1 }, position: [0, 0] },
    { name: "pole", shape: { type: "box", half_width: 0.02, half_height: 0.5 }, position: [0, -0.5] },
  ],
  joints: [
    { name: "pivot", kind: "revolute", body: "pole", parent: "cart", anchor: [0, 0] },
    { name: "slide", kind: "prismatic", body: "cart", anchor: [0, 0], axis: [2, 0] },
  ],
};

test("bodies are where the joints put them, whatever the order of the joints and the length of the axis", () => {
  const at = poses(CART, { slide: 0.3, pivot: Math.PI / 2 });
  const { x, y, angle } = at.get("pole")!;
  assert.ok(Math.abs(x - 0.8) < 1e-12 && Math.abs(y) < 1e-12 && angle === Math.PI / 2);
  assert.equal(at.get("cart")!.x, 0.3);
});

test("the picture holds what hinges reach and where slides were", () => {
  const [left, bottom, right, top] = reach(CART, { slide: [-2, 0.4] });
  assert.ok(left <= -3 && right >= 1.4 && bottom <= -1 && top >= 1);
});

test("scenes without joints are no mechanisms", () => {
  assert.equal(mechanismOf({ format: "iplw.scene/1", bodies: [] }), null);
  assert.equal(mechanismOf(null), null);
});

test("recordings are read by trial, and errors name the line and the column", () => {
  const trials = parseRecording("log.csv", "trial,t,slide,pivot,slide.command\n0,0,0,1,2\n0,0.5,1,1,2\n1,0,0,0,0\n", CART);
  assert.deepEqual(trials.map((t) => t.id), ["0", "1"]);
  assert.deepEqual(trials[0]!.commands, { slide: [2, 2] });
  assert.deepEqual([positionsAt(trials[0]!, 0.4).slide, positionsAt(trials[0]!, 9).slide], [0, 1]);
  assert.throws(() => parseRecording("log.csv", "trial,t,slide\n0,0,0\n", CART), /no column pivot/);
  assert.throws(() => parseRecording("log.csv", "trial,t,slide,pivot\n0,0,0,1\n0,x,0,1\n", CART), /line 3 has no number in the column t/);
});
