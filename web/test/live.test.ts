import assert from "node:assert/strict";
import { test } from "node:test";
import { ago, clock, day, duration } from "../src/parts/time";
import { applyEvent, type WorldEvent, eventText, type World } from "../src/views/live/messages";

const world = { id: "w", budget: 3, remaining: 3, interactions: 0, state: { task: null, phase: "new", episodes: 0 } } as unknown as World;
const event = (of: Partial<WorldEvent>): WorldEvent => ({ number: 1, interactions: 0, what: "step", ...of });

test("long durations are rounded coarsely", () => {
  assert.deepEqual([0, 9, 10, 59, 300, 9000].map(ago), ["now", "now", "10 s ago", "50 s ago", "5 min ago", "3 h ago"]);
  assert.deepEqual([0.2, 89, 120].map(duration), ["1 s", "89 s", "2 min"]);
  assert.match(clock(1.6e9), /^\d\d:\d\d:\d\d$/);
  assert.match(day(1.6e9), /^2020-09-1\d$/);
});

test("a world's state is updated from its events", () => {
  const reset = applyEvent(world, event({ what: "reset", task: "bowling:003" }));
  assert.deepEqual(reset.state, { task: "bowling:003", phase: "ready", episodes: 1 });
  const refused = applyEvent(reset, event({ valid: false, reason: "overlaps green" }));
  assert.equal(refused.state.phase, "ready");
  const done = applyEvent(refused, event({ valid: true, solved: true, interactions: 2 }));
  assert.deepEqual([done.state.phase, done.interactions, done.remaining], ["done", 2, 1]);
  const set = applyEvent(done, event({ what: "latents", interactions: 2, latents: { friction: 0.5 } }));
  assert.equal(set.latents?.friction, 0.5);
  assert.equal(world.interactions, 0);
});

test("events are formatted in one line", () => {
  assert.equal(eventText(event({ what: "reset", task: "bowling:003" })), "Reset to bowling:003");
  assert.equal(eventText(event({ action: [0.5, 1], valid: false, reason: "overlaps green" })), "Step at 0.500, 1.000: not placed: overlaps green");
  assert.equal(eventText(event({ action: [0.5], valid: true, solved: true })), "Step at 0.500: solved");
  assert.equal(eventText(event({ action: [0.5], valid: true, solved: false, end: "diverged" })), "Step at 0.500: diverged");
  assert.equal(eventText(event({ what: "attempts", task: "t", attempts: { tried: 1, valid: 1, solved: 0 } })), "1 attempt on t: 1 placed, 0 solved");
  assert.equal(eventText(event({ what: "gone" })), "The world was deleted");
});
