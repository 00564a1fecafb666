import assert from "node:assert/strict";
import { test } from "node:test";
import { actionText, enumeration } from "../src/views/analysis/actionText";
import { physicsFrom, physicsOf, physicsText, type ParameterSamples } from "../src/views/analysis/physics";
import { headline as designHeadline, narrowingText, type Design, type Experiment } from "../src/views/design/result";
import { headline as planHeadline, isUncertain, type Plan, probabilityText, type RankedAction } from "../src/views/plan/result";
import { tableOf } from "../src/views/posterior/diagnosisTrials";
import { gainText, headline as posteriorHeadline, type Posterior, type PosteriorParameter, valueText } from "../src/views/posterior/result";
import { headline as surfaceHeadline, stakeText } from "../src/views/surface/result";
import { VIEW_GROUPS } from "../src/views";
import type { Scene } from "../src/scene/types";

test("the navigation has twelve views, each once, under short group titles", () => {
  const ids = VIEW_GROUPS.flatMap((group) => group.views.map((view) => view.id));
  assert.equal(ids.length, 12);
  assert.equal(new Set(ids).size, 12);
  for (const group of VIEW_GROUPS) assert.ok(group.title.length <= 8 && group.views.length <= 3, group.title);
});

const SAMPLES: ParameterSamples = {
  format: "iplw.posterior/2",
  columns: { friction: [0.2, 0.4], "linear_drag.c": [0.3, null], "wind.ax": [null, null] },
  effects: [{ name: "wind", parameters: { ax: 1, ay: 2 } }],
  discrepancy: [{ effects: [{ name: "velocity_push", parameters: { ux: 5 } }], draws: [1], amplitudes: [[0.7, -0.1]] }],
};

test("samples of a posterior are worlds with latents, effects and their force field", () => {
  const parameter = (name: string): { name: string; unit: string; bounds: number[]; neutral: number } => ({ name, unit: "1", bounds: [0, 1], neutral: 0 });
  const library = [{ name: "velocity_push", acts_on: "motion", equation: "", parameters: ["ax", "ay", "ux"].map(parameter) }];
  const wind = { name: "wind", parameters: { ax: 1, ay: 2 } };
  const first = physicsOf(SAMPLES, 0, library);
  assert.deepEqual(first, { latents: { friction: 0.2 }, effects: [wind, { name: "linear_drag", parameters: { c: 0.3 } }], field: [] });
  const second = physicsOf(SAMPLES, 1, library);
  assert.deepEqual(second.field, [{ name: "velocity_push", parameters: { ax: 0.7, ay: -0.1, ux: 5 } }]);
  assert.match(physicsText(second), /friction 0.400, wind \(ax 1.00, ay 2.00\), an unnamed force field/);
  // Half of the samples have drag: that is not most of them.
  const mean = physicsOf(SAMPLES, null, library);
  assert.deepEqual(mean.effects, [wind]);
  assert.ok(Math.abs(mean.latents.friction! - 0.3) < 1e-12);
  assert.deepEqual(physicsFrom([["density", null]]), { latents: {}, effects: [] });
});

test("actions are described in SI units", () => {
  const component = (set: "x" | "radius", high: number): object => ({ target: "red", set, low: 0, high });
  const scene = { format: "iplw.scene/1", bodies: [], action: { components: [component("x", 40), component("radius", 5)] } } as unknown as Scene;
  assert.equal(actionText(scene, [0.5, 0.2]), "red: x 20.0 m, radius 1.00 m");
  assert.equal(enumeration(["a", "b", "c"]), "a, b and c");
});

test("a plan's headline has its probability and its worlds", () => {
  const action: RankedAction = { action: [0.5], successes: 15, draws: 16, share: 0.9, probability: 0.9375, standard_error: 0.07 };
  const plan = { task: "bowling:003", config: { exact: 10 }, posterior: { source: "posterior", draws: 64 }, actions: [action] } as unknown as Plan;
  assert.equal(planHeadline(plan, false), "The action ranked first solves bowling:003 with a probability of 94 % under the posterior.");
  assert.equal(probabilityText(action), "94 ± 7 %");
  assert.equal(isUncertain(plan), false);
  assert.equal(isUncertain({ ...plan, actions: [{ ...action, probability: 0.5 }] }), true);
});

test("narrowing is described by its size", () => {
  const text = (after: number): string | null => narrowingText({ name: "linear_drag.c", before: 1, after });
  assert.equal(text(0.99), null);
  assert.equal(text(0.8), "reduces the uncertainty of linear drag c by 20 %");
  assert.equal(text(0.5), "halves the uncertainty of linear drag c");
  assert.equal(text(0.33), "reduces the uncertainty of linear drag c to a third");
  assert.equal(text(0.1), "makes linear drag c 10 times more precise");
  assert.equal(text(1e-9), "makes linear drag c more than 1000 times more precise");
  const experiment = { expected: [{ name: "density", before: 1, after: 1 }, { name: "friction", before: 1, after: 0.5 }] } as unknown as Experiment;
  const design = { experiments: [experiment], together: { information: 1, standard_error: 0.1, right: null } } as unknown as Design;
  assert.equal(designHeadline(design), "The best next experiment halves the uncertainty of friction.");
  const named = { ...design, together: { ...design.together, right: [0.333, 0.91] as [number, number] } };
  assert.match(designHeadline(named), /from 33 % to 91 %/);
});

test("a posterior's headline names what is identified", () => {
  const parameter = (name: string, identifiable: boolean): PosteriorParameter => ({ name, identifiable, unit: "1/s", setting: null, mean: 0.22317, sd: 0.0042, quantiles: [], left: 0.02 });
  const posterior = { parameters: [parameter("friction", true), parameter("linear_drag.c", true), parameter("density", false)] } as unknown as Posterior;
  assert.equal(posteriorHeadline(posterior), "The trials identify friction and linear drag c, but not density.");
  assert.equal(valueText(parameter("friction", true)), "0.2232 ± 0.0042 1/s");
  assert.equal(gainText(parameter("friction", true)), "50 times narrower than the prior");
  assert.equal(gainText({ ...parameter("density", false), left: 1.02 }), "as wide as the prior");
});

test("a surface's headline names the latent that matters", () => {
  const of = (friction: number, restitution: number): string => surfaceHeadline("bowling", [{ factor: "restitution", slope: 1, stake: restitution }, { factor: "friction", slope: 1, stake: friction }]);
  assert.equal(of(0.1, 0.02), "Friction matters most for bowling: measure it first.");
  assert.equal(of(0.1, 0.09), "Friction and restitution matter about equally for bowling.");
  assert.match(of(0.01, 0.01), /matters much/);
  assert.match(stakeText({ factor: "friction", slope: 1, stake: 0.111, sd: 0.27 }), /\(0.270\) in friction changes the score by about 0.11/);
});

test("trials of a diagnosis become a table without missing values", () => {
  const track = (x: (number | null)[]): object => ({ x, y: x, angle: x, vx: x, vy: x, omega: x });
  const trials = [{ trial: "a,b", setting: null, t: [0, 0.1], bodies: { ball: track([1, null]) } }] as unknown as Parameters<typeof tableOf>[0];
  assert.equal(tableOf(trials), 'trial,t,body,x,y\n"a,b",0,ball,1,1');
});
