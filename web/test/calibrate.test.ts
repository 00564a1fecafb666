import assert from "node:assert/strict";
import { test } from "node:test";
import { span } from "../src/parts/bandPlot";
import type { Film } from "../src/scene/film";
import { simulationPhysics } from "../src/views/calibrate/estimation";
import { significantDigits } from "../src/views/calibrate/findings";
import { blankTrials } from "../src/views/calibrate/askTell";
import { parseBlock } from "../src/views/calibrate/resultTable";
import { rmsDistance, filmOfTrial, observations } from "../src/views/calibrate/tracks";

const none = [null, null, null];
const trial = {
  trial: "a/0",
  proposal: 0,
  round: 0,
  task: "a:000",
  action: [],
  t: [0, 1, 2],
  bodies: {
    ball: { x: [0, null, 2], y: [1, null, 1], angle: none, vx: none, vy: none, omega: none },
    cup: { x: none, y: none, angle: none, vx: none, vy: none, omega: none },
  },
};

test("unobserved states are neither compared nor plotted", () => {
  const simulated: Film = { t: [0, 1, 2], bodies: { ball: { x: [3, 9, 5], y: [1, 9, 1], angle: [0, 0, 0] } }, contacts: [] };
  assert.deepEqual(observations(trial, "ball").map((p) => p.t), [0, 2]);
  assert.equal(observations(trial, "moon").length, 0);
  assert.equal(rmsDistance(simulated, trial), 3);
  assert.equal(rmsDistance({ ...simulated, bodies: {} }, trial), null);
  const film = filmOfTrial(trial)!;
  assert.deepEqual([film.t, Object.keys(film.bodies), film.bodies.ball!.x], [[0, 2], ["ball"], [0, 2]]);
  assert.equal(filmOfTrial({ ...trial, bodies: { cup: trial.bodies.cup } }), null);
});

test("an estimate is simulated with the jointly fitted effects", () => {
  const of = (name: string, value: number) => ({ name, value, ci95: [null, null] as [null, null], identifiable: false });
  assert.deepEqual(simulationPhysics([of("friction", 0.4), of("wind.ax", 1), of("wind.ay", 2), of("linear_drag.c", 3)]), {
    latents: { friction: 0.4 },
    effects: [{ name: "wind", parameters: { ax: 1, ay: 2 } }, { name: "linear_drag", parameters: { c: 3 } }],
  });
});

test("an axis covers all values and finite bounds, at round numbers", () => {
  for (const [low, high] of [[0.83, 0.8303], [0, 0], [-3, 12], [1e-5, 3e-5]] as const) {
    const axis = span([{ x: 1, y: low, low: null, high: null }, { x: 2, y: high, low, high }], false);
    assert.ok(axis.low <= low + 1e-12 && axis.high >= high - 1e-12 && axis.low < axis.high, JSON.stringify(axis));
    assert.ok(axis.ticks.length <= 7, String(axis.ticks));
  }
  assert.deepEqual(span([{ x: 1, y: 2166 }, { x: 2, y: 30 }, { x: 3, y: 0 }], true), { low: 10, high: 10_000, ticks: [10, 100, 1000, 10_000] });
  assert.deepEqual(span([], false).ticks, [0, 1]);
});

test("the bounds of an interval are formatted distinguishably", () => {
  assert.deepEqual([4, 0.3, 0.04, 0.0004, 0, 1e-20].map(significantDigits), [3, 3, 3, 5, 3, 9]);
});

test("pasted spreadsheet ranges and files are parsed into cells", () => {
  const expected = [["0", "1.5", ""], ["0.1", "1.6", "2"]];
  assert.deepEqual(parseBlock("0\t1.5\t\n0.1\t1.6\t2\n"), expected);
  assert.deepEqual(parseBlock("0;1.5;\r\n0.1;1.6;2"), expected);
  assert.deepEqual(parseBlock("0, 1.5,\n0.1 , 1.6,2"), expected);
  assert.deepEqual(parseBlock("0,5\t1,5"), [["0,5", "1,5"]]);
});

test("a template file has a row for each body and time", () => {
  const scene = { bodies: [{ name: "a" }, { name: "b" }] };
  assert.equal(blankTrials([{ number: 4, scene: scene as never, observe_at: [0, 0.25] }]), "trial,t,body,x,y\n4,0,a,,\n4,0,b,,\n4,0.25,a,,\n4,0.25,b,,\n");
});
