import assert from "node:assert/strict";
import { test } from "node:test";
import { pathCorners, sceneExtent } from "../src/scene/extent";
import type { Film } from "../src/scene/film";
import { goalWords } from "../src/scene/goal";
import { accelerationAt, largest, velocityAt } from "../src/scene/motion";
import type { Scene } from "../src/scene/types";
import { roundBelow } from "../src/scene/viewControls";
import { sceneEffects, sceneWithout } from "../src/views/play/sceneEffects";

const drop: Scene = {
  format: "iplw.scene/1",
  bodies: [{ name: "ball", shape: { type: "disc", radius: 0.1 }, position: [0, 1] }],
  statics: [{ name: "floor", shape: { type: "halfspace", normal: [0, 2], offset: 0 } }],
};

/** Free fall onto a floor at 0.4 s, then rest. */
function fall(): Film {
  const t = Array.from({ length: 49 }, (_, k) => k / 60);
  const y = t.map((v) => 0.8 - 5 * Math.min(v, 0.4) ** 2);
  return { t, bodies: { ball: { x: t.map((v) => v), y, angle: t.map(() => 0) } }, contacts: [{ t: 0.4, between: ["ball", "floor"], speed: 4 }] };
}

test("goals are clauses", () => {
  assert.equal(goalWords({ type: "contact", bodies: ["green", "blue"], hold_s: 3 }), "green and blue touch for 3 s");
  assert.equal(goalWords({ type: "apart", bodies: ["a", "b"], after_touch: true }), "a and b are apart, after they have touched");
  assert.equal(goalWords({ type: "inside", body: "ball", region: [] }), "ball is in the goal region");
  assert.equal(goalWords({ type: "above", body: "ball", height: 1.25, point: "centre", hold_s: 0.5 }), "the centre of ball is above 1.25 m for 0.5 s");
});

test("a disc over a floor has surroundings and its floor in view", () => {
  const [left, bottom, right, top] = sceneExtent(drop);
  assert.ok(right - left >= 1 && bottom <= 0 && top >= 1.1, `${[left, bottom, right, top]}`);
  assert.deepEqual(pathCorners([[0, 0], [1e9, 2], [Number.NaN, 0]], 0.1, [0, 0, 2, 2]), [[-0.1, -0.1], [10, 2.1]]);
});

test("velocity and acceleration are differences, without the jumps of contacts", () => {
  const film = fall();
  const [vx, vy] = velocityAt(film, "ball", 0.2)!;
  assert.ok(Math.abs(vx - 1) < 1e-9 && Math.abs(vy + 2) < 0.1, `${vx} ${vy}`);
  const [ax, ay] = accelerationAt(film, "ball", 0.2)!;
  assert.ok(Math.abs(ax) < 1e-9 && Math.abs(ay + 10) < 1e-6, `${ax} ${ay}`);
  assert.equal(accelerationAt(film, "ball", 0.4), null);
  assert.ok(Math.abs(accelerationAt(film, "ball", 0.6)![1]) < 1e-9);
  assert.ok(Math.abs(largest(film, accelerationAt) - 10) < 1e-6);
});

test("lengths of scale bars are round", () => {
  for (const [limit, length] of [[1, 1], [4.9, 2], [5, 5], [0.099, 0.05], [1234, 1000]] as const) assert.ok(Math.abs(roundBelow(limit) - length) < 1e-9, `${limit}`);
});

test("effects of a scene are named, grouped and removed", () => {
  const push = { name: "place_push", parameters: { ax: 1 } };
  const scene: Scene = { ...drop, damping: 0.8, effects: [push, { name: "linear_drag", parameters: { c: 0.8 } }, push] };
  const library = [{ name: "linear_drag", acts_on: "motion", equation: "a = -c v", parameters: [{ name: "c", unit: "1/s", bounds: [0, 9], neutral: 0 }] }];
  const effects = sceneEffects(scene, library);
  assert.deepEqual(effects.map((e) => e.title), ["linear drag", "linear drag", "empirical force field"]);
  assert.equal(effects[0]!.detail, "a = -c v; c = 0.8 1/s");
  assert.match(effects[2]!.detail, /2 terms/);
  assert.deepEqual(sceneWithout(scene, [effects[2]!]).effects, [scene.effects![1]]);
  assert.equal(sceneWithout(scene, [effects[1]!]).damping, undefined);
  assert.equal(sceneWithout(scene, []), scene);
});
