import assert from "node:assert/strict";
import { test } from "node:test";
import type { Schema } from "../src/api/client";
import type { Scene } from "../src/scene/types";
import { cellOf, bestByCell, actionGrid, cellBox, placementAxes, ranges, solvedByCell, strength, groupNearby } from "../src/views/train/actionGrid";
import { updateCurves, type Curves } from "../src/views/train/trainingProgress";
import { auccess, meanCurve, difference, learningChains, curve, evaluation, hasSetting, mean, means, trainingKey, movingAverage, wilson, taskScore } from "../src/views/train/scores";

type Job = Schema<"JobOut">;

function near(actual: number, expected: number): void {
  assert.ok(Math.abs(actual - expected) < 1e-9, `${actual}, not ${expected}`);
}

test("AUCCESS equals the server's: its weights telescope", () => {
  const from = (k: number): number => Math.log(101 / k) / Math.log(101);
  const check = (solvedAt: (number | null)[], expected: number): void => near(auccess(solvedAt).value, expected);
  check([null], 0);
  check([1], 1);
  check([100], from(100));
  check([101], 0);
  check([1, 10, null, 3], (1 + from(10) + from(3)) / 4);
  // By the definition: the weighted area under the curve.
  const shares = curve([2, 7, null], 100).map((p) => p.value);
  const weights = shares.map((_, i) => Math.log(i + 2) - Math.log(i + 1));
  const area = shares.reduce((sum, share, i) => sum + share * weights[i]!, 0) / weights.reduce((a, b) => a + b, 0);
  near(auccess([2, 7, null]).value, area);
  assert.equal(taskScore(null), 0);
});

test("Wilson's interval equals reference values, and is not empty if all or none are solved", () => {
  // Brown, Cai and DasGupta (2001): 95 % of 5 in 20.
  const { low, high } = wilson(5, 20);
  assert.ok(Math.abs(low - 0.1119) < 1e-3 && Math.abs(high - 0.4687) < 1e-3, `${low} ${high}`);
  assert.ok(wilson(0, 20).high > 0.1 && wilson(0, 20).low === 0);
  assert.ok(wilson(20, 20).low < 0.9 && wilson(20, 20).high > 1 - 1e-9);
  assert.deepEqual(wilson(0, 0), { value: 0, low: 0, high: 1 });
});

test("equal tasks are compared pairwise", () => {
  // Tasks differ much, the policies differ by the same on each: the difference is sharp, the means are not.
  const [one, other] = [[1, 5, 25], [2, 10, 50]];
  const ahead = difference(one, other)!;
  near(ahead.value, Math.log(2) / Math.log(101));
  assert.ok(ahead.high - ahead.low < 1e-9 && auccess(one).high - auccess(one).low > 0.3);
  assert.equal(difference([1], [1, 2]), null);
  assert.deepEqual(mean([0.5]), { value: 0.5, low: 0, high: 1 });
});

test("an evaluation has its settings, with the server's defaults", () => {
  const result = { auccess: 0.5, interactions: 12, tasks: [{ task: "a", solved_at: 3 }, { task: "b", solved_at: null }] };
  const job = { id: "job-1", kind: "evaluate", seed: 0, config: { policy: "random", world: "w" }, result } as unknown as Job;
  const evaluated = evaluation(job)!;
  assert.ok(hasSetting(evaluated, { world: "w", split: "test", attempts: 100, seed: 0 }));
  assert.ok(!hasSetting(evaluated, { world: "w", split: "test", attempts: 100, seed: 1 }));
  assert.deepEqual(evaluated.solvedAt, [3, null]);
  assert.equal(evaluation({ ...job, result: null } as unknown as Job), null);
});

test("policies trained from one another form one chain", () => {
  const learners = [
    { id: "p1", from: null, attempts: 0 },
    { id: "p2", from: "p1", attempts: 100 },
    { id: "p3", from: "p2", attempts: 50 },
    { id: "d", from: "untrained", attempts: 80 },
    { id: "alone", from: null, attempts: 0 },
  ];
  assert.deepEqual(learningChains(learners), [
    [{ id: "p1", attempts: 0 }, { id: "p2", attempts: 100 }, { id: "p3", attempts: 150 }],
    [{ id: "d", attempts: 80 }],
  ]);
  assert.deepEqual(learningChains([{ id: "a", from: "b", attempts: 1 }, { id: "b", from: "a", attempts: 1 }]), []);
});

test("policies that differ only by their seed share a key, and so do policies trained from them identically", () => {
  const policy = (id: string, training: string, config: object, job: string | null = "job-1"): Schema<"PolicyOut"> => ({ id, training, config, job }) as unknown as Schema<"PolicyOut">;
  const all = [
    policy("a", "fixed", { task: "bowling", seed: 1 }),
    policy("b", "fixed", { seed: 2, task: "bowling", validations: 5 }),
    policy("c", "fixed", { task: "bowling", seed: 1, batches: 9 }),
    policy("a2", "learned_on", { world: "w", policy: "a", seed: 1 }),
    policy("b2", "learned_on", { policy: "b", world: "w" }),
    policy("c2", "learned_on", { policy: "c", world: "w" }),
    policy("up", "uploaded", {}, null),
  ];
  const of = (id: string): string => trainingKey(all, id);
  assert.ok(of("a") === of("b") && of("a2") === of("b2"));
  assert.equal(new Set(["a", "c", "a2", "c2", "up", "random"].map(of)).size, 6);
  const [{ value, low, high }] = meanCurve([[{ value: 0.4, low: 0, high: 1 }], [{ value: 0.6, low: 0, high: 1 }]]) as [{ value: number; low: number; high: number }];
  assert.ok(Math.abs(value - 0.5) < 1e-12 && low > 0.3 && high < 0.7);
});

test("losses are averaged in bins, each loss in one bin", () => {
  assert.deepEqual(means([1, 3, 5, 7, 9], 3), [{ at: 2, value: 2 }, { at: 4, value: 6 }, { at: 5, value: 9 }]);
  assert.deepEqual(means([], 3), []);
  assert.deepEqual(movingAverage([4, 0, 2, 6, 4], 3), [2, 2, 8 / 3, 4, 5]);
  assert.deepEqual(movingAverage([], 3), []);
});

test("curves grow with events, restart with the training, and end with its result", () => {
  const job = (state: string, stage: string, figures: object[], result: object | null = null): Job =>
    ({ state, progress: { stage, done: 0, total: 0, figures }, result }) as unknown as Job;
  let now: Curves = { loss: [], validation: [] };
  now = updateCurves(now, job("running", "train", [{ name: "loss", at: 1, value: 0.7 }, { name: "validation", at: 0, value: 0.2 }]));
  now = updateCurves(now, job("running", "train", [{ name: "loss", at: 2, value: 0.6 }, { name: "unheard of", at: 2, value: 0.6 }]));
  assert.deepEqual(now, { loss: [{ at: 1, value: 0.7 }, { at: 2, value: 0.6 }], validation: [{ at: 0, value: 0.2 }] });
  assert.deepEqual(updateCurves(now, job("running", "label", [])), { loss: [], validation: [] });
  assert.deepEqual(updateCurves(now, job("queued", "train", [])), { loss: [], validation: [] });
  assert.deepEqual(updateCurves(now, job("cancelled", "train", [])), now);
  const done = updateCurves(now, job("succeeded", "train", [], { loss: [3, 1], validation: [{ batches: 2, auccess: 0.4 }] }));
  assert.deepEqual(done, { loss: [{ at: 1, value: 3 }, { at: 2, value: 1 }], validation: [{ at: 2, value: 0.4 }] });
});

const scene = {
  action: {
    components: [
      { target: "ball", set: "x", low: 0, high: 10 },
      { target: "ball", set: "y", low: 10, high: 20 },
      { target: "ball", set: "radius", low: 1, high: 2 },
      { target: "plank", set: "angle", low: 0, high: 1 },
    ],
  },
} as unknown as Scene;

test("a map has cells in metres, with the best action and the solved share of each", () => {
  assert.deepEqual(placementAxes(scene), [{ target: "ball", x: 0, y: 1 }]);
  const many = Array.from({ length: 30 }, (_, i) => [i / 29, i / 29]);
  const grid = actionGrid({ target: "ball", x: 0, y: 1 }, many, 5);
  assert.equal(cellOf(grid, [0, 0, 0]), 0);
  assert.equal(cellOf(grid, [1, 1, 0]), 24);
  assert.deepEqual(cellBox(grid, scene.action!.components, 6), [2, 12, 2, 2]);
  // Of actions on a coarse lattice each place has its cell, with the place in its middle.
  const lattice = actionGrid(grid.axes, [0, 1, 2].flatMap((i) => [0, 1].map((j) => [i / 2, j])), 5);
  assert.deepEqual([lattice.columns, lattice.rows], [[-0.25, 0.25, 0.75, 1.25], [-0.5, 0.5, 1.5]]);
  assert.deepEqual([[0, 0], [1, 0], [0, 1], [1, 1]].map((a) => cellOf(lattice, a)), [0, 2, 3, 5]);
  const actions = [[0.5, 0.5, 0], [0.1, 0.1, 0], [0.51, 0.5, 0.9]];
  assert.deepEqual([...bestByCell(grid, actions)], [[12, 0], [0, 1]]);
  assert.deepEqual([...solvedByCell(grid, actions, [false, false, true])], [[12, { of: 2, solve: 1, one: 2 }], [0, { of: 1, solve: 0, one: null }]]);
});

test("earlier tries are more opaque, and tries at one position share a label", () => {
  const ranks = [1, 2, 10, 100, 1000].map((rank) => strength(rank, 1000));
  assert.equal(ranks[0], 1);
  assert.ok(ranks.every((v, i) => i === 0 || v < ranks[i - 1]!) && ranks.at(-1)! >= 0);
  assert.deepEqual(groupNearby([[0, 0], [5, 5], [0.1, 0]], 1), [[0, 2], [1]]);
  assert.equal(ranges([1, 2, 3, 4, 6, 8, 9]), "1–4, 6, 8, 9");
});
