import assert from "node:assert/strict";
import { test } from "node:test";
import { ticks } from "../src/parts/timePlot";
import { latest } from "../src/parts/latest";
import { posesAt, distanceOverTime, type Film, pathUntil } from "../src/scene/film";
import { applyAction, shareFor, valueAt } from "../src/scene/action";
import type { Scene } from "../src/scene/types";
import { halfPlane, sceneExtent } from "../src/scene/extent";

const scene: Scene = {
  format: "iplw.scene/1",
  bodies: [{ name: "red", shape: { type: "disc", radius: 1 } }, { name: "blue", shape: { type: "box", half_width: 1, half_height: 2 }, position: [4, 2] }],
  statics: [{ name: "floor", shape: { type: "segment", from: [-100, 0], to: [100, 0] } }],
  action: {
    components: [
      { target: "red", set: "x", low: 0, high: 10 },
      { target: "red", set: "y", low: 5, high: 5 },
      { target: "red", set: "radius", low: 0.5, high: 1.5 },
    ],
  },
};

function film(t: number[], y: (t: number) => number): Film {
  return { t, bodies: { red: { x: t.map((v) => 2 * v), y: t.map(y), angle: t.map(() => 0) } }, contacts: [] };
}

test("an action sets its components' targets without changing the scene", () => {
  const done = applyAction(scene, [0.25, 0.9, 1]);
  assert.deepEqual(done.bodies[0]!.position, [2.5, 5]);
  assert.deepEqual(done.bodies[0]!.shape, { type: "disc", radius: 1.5 });
  assert.equal(scene.bodies[0]!.position, undefined);
  const x = scene.action!.components[0]!;
  assert.equal(shareFor(x, valueAt(x, 0.3)), 0.3);
  assert.equal(shareFor(x, 99), 1);
  assert.equal(shareFor(scene.action!.components[1]!, 5), 0);
});

test("a picture's extent covers bodies, and long floors only near them", () => {
  const [left, bottom, right, top] = sceneExtent(scene);
  assert.ok(left > -5 && right < 10, `${left} to ${right}`);
  assert.ok(bottom <= 0 && top >= 4, `${bottom} to ${top}`);
  assert.deepEqual(halfPlane([0, 1], 0, [-1, -1, 1, 1]), [[-1, -1], [1, -1], [1, 0], [-1, 0]]);
  assert.deepEqual(halfPlane([0, 1], -2, [-1, -1, 1, 1]), []);
});

test("videos hold at their start and end, and pass through their samples", () => {
  const fall = film([0, 0.25, 0.5], (t) => 1 - 4 * t * t);
  for (const t of [0, 0.25, 0.5]) assert.ok(Math.abs(posesAt(fall, t).get("red")!.y - (1 - 4 * t * t)) < 1e-12);
  assert.equal(posesAt(fall, -1).get("red")!.y, 1);
  assert.equal(posesAt(fall, 9).get("red")!.x, 1);
  assert.equal(pathUntil(fall, "red", 0.3).length, 3);
});

test("interpolation between coarse samples does not overshoot", () => {
  const bounce = film([0, 0.25, 0.5, 0.75], (t) => Math.abs(t - 0.4));
  for (let t = 0; t <= 0.75; t += 0.01) {
    const { y } = posesAt(bounce, t).get("red")!;
    assert.ok(y >= 0.1 - 1e-9 && y <= 0.4 + 1e-9, `${y} at ${t}`);
  }
});

test("the distance is computed at measured times, over the common duration", () => {
  const fine = film(Array.from({ length: 61 }, (_, k) => k / 60), (t) => t);
  const measured = film([0, 0.5, 1, 1.5], (t) => t + 0.3);
  const { t, bodies } = distanceOverTime(fine, measured);
  assert.deepEqual(t, [0, 0.5, 1]);
  for (const apart of bodies.get("red")!) assert.ok(Math.abs(apart - 0.3) < 1e-9);
});

test("only the latest request is sent after the one in progress", async () => {
  const [done, ends]: [number[], (() => void)[]] = [[], []];
  const ask = latest<number>(async (value) => {
    await new Promise<void>((resolve) => ends.push(resolve));
    done.push(value);
  });
  for (const value of [1, 2, 3, 4]) ask(value);
  while (ends.length) {
    ends.shift()!();
    await new Promise((resolve) => setImmediate(resolve));
  }
  assert.deepEqual(done, [1, 4]);
});

test("ticks are round and cover the range", () => {
  assert.deepEqual(ticks(1, 4).map((v) => Number(v.toFixed(9))), [0, 0.5, 1]);
  for (const most of [0.013, 0.7, 3.3, 16.7, 420]) assert.ok(ticks(most, 4).at(-1)! >= most);
});
