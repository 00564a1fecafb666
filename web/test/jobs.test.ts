import assert from "node:assert/strict";
import { test } from "node:test";
import { differences, flatten } from "../src/views/jobs/flatten";
import { durationOf, type Job, subjectOf, titleOf } from "../src/views/jobs/job";
import { sorted, withText } from "../src/views/jobs/order";
import { exactDuration } from "../src/views/jobs/times";

const job = (number: number, of: Partial<Job> = {}): Job =>
  ({ id: `job-${number}`, kind: "iplw", state: "succeeded", config: { task: "bowling" }, progress: { stage: "", done: 0, total: 0 }, seed: 0, version: "0", ...of }) as Job;
const ids = (jobs: readonly Job[]): string => jobs.map((j) => j.id.slice(4)).join(" ");

test("jobs are sorted by a column, jobs without a value last", () => {
  const all = [job(1, { started: 30, ended: 40, owner: "b" }), job(2, { started: 10, ended: 60 }), job(10, { kind: "train", created: 50, owner: "a" })];
  const by = (column: Parameters<typeof sorted>[1]["by"], descending: boolean): string => ids(sorted(all, { by: column, descending }, 100));
  assert.equal(by("started", true), "10 1 2");
  assert.equal(by("duration", true), "2 1 10");
  assert.equal(by("duration", false), "1 2 10");
  assert.equal(by("who", false), "10 1 2");
  assert.equal(by("who", true), "1 10 2");
  assert.equal(by("kind", false), "2 1 10");
  assert.equal(ids(sorted([job(9), job(10)], { by: "started", descending: true })), "10 9");
});

test("jobs are found by name, note, subject and id", () => {
  const all = [job(1, { name: "Drag study" }), job(2, { note: "try drag again" }), job(3, { config: { policy: "random", world: "w1" } as never })];
  assert.equal(ids(withText(all, "drag")), "1 2");
  assert.equal(ids(withText(all, " DRAG study ")), "1");
  assert.equal(ids(withText(all, "w1 random")), "3");
  assert.equal(ids(withText(all, "")), "1 2 3");
});

test("a job without a name is titled by kind and subject", () => {
  assert.equal(titleOf(job(1)), "Estimation: bowling");
  assert.equal(titleOf(job(1, { name: "Mine" })), "Mine");
  assert.equal(subjectOf(job(1, { config: { scene: { name: "table" }, world: "w1" } as never })), "table in w1");
  assert.equal(titleOf(job(1, { kind: "plan", config: {} as never })), "Plan");
  assert.equal(durationOf(job(1, { started: 5 }), 8), 3);
  assert.equal(durationOf(job(1)), null);
});

test("a configuration is flattened into rows", () => {
  const rows = flatten({ task: "t", latents: { friction: 0.5 }, none: null, fit: ["a", "b"], effects: [{ name: "wind", parameters: { ax: 1 } }], scene: { format: "iplw.scene/1", name: "table", bodies: [1] }, refine: true });
  assert.deepEqual(rows.map((r) => `${r.path} = ${r.text}`), ["task = t", "latents › friction = 0.5", "fitted effects = a, b", "effects › wind › parameters › ax = 1", "scene = table, iplw.scene/1", "refine = yes"]);
  const { differing, equal } = differences(rows, flatten({ task: "t", latents: { friction: 0.6 }, budget: 3 }));
  assert.deepEqual(equal.map((r) => r.path), ["task"]);
  assert.deepEqual(differing.find((d) => d.path === "latents › friction")?.texts, ["0.5", "0.6"]);
  assert.deepEqual(differing.at(-1), { path: "budget", texts: [null, "3"] });
});

test("durations have two units", () => {
  assert.deepEqual([0.31, 42, 125, 3700, 200_000].map(exactDuration), ["0.3 s", "42 s", "2 min 5 s", "1 h 1 min", "2 d 7 h"]);
});
