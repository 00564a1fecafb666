import assert from "node:assert/strict";
import { test } from "node:test";
import { ago, clock, day, duration } from "../src/parts/time";
import { auccessOf, episodeLog, successShares } from "../src/views/live/episodes";
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

test("episodes are counted from events", () => {
  const log = episodeLog(3);
  const step = (solved: boolean, valid = true): boolean => log.add(event({ valid, solved }));
  log.add(event({ what: "reset" }));
  assert.deepEqual([step(false, false), step(false), step(true)], [false, false, true]);
  // Steps after the end belong to no episode; an abandoned episode is not solved.
  assert.equal(step(true), false);
  log.add(event({ what: "reset" }));
  step(false);
  assert.equal(log.add(event({ what: "reset" })), true);
  assert.deepEqual([step(false), step(false), step(false)], [false, false, true]);
  assert.deepEqual(log.episodes().map((e) => e.solved), [true, false, false]);
  assert.deepEqual(log.episodes().map((e) => e.return), [auccessOf(2, 3), 0, 0]);
  assert.ok(Math.abs(auccessOf(2, 3) - 0.5) < 1e-12);
});

test("the share of successes is over the last 20 episodes", () => {
  const episodes = Array.from({ length: 30 }, (_, i) => ({ number: i + 1, solved: i >= 10, return: 0 }));
  const shares = successShares(episodes);
  assert.deepEqual([shares[0], shares[9], shares[19], shares[29]], [0, 0, 0.5, 1]);
});
