import assert from "node:assert/strict";
import { test } from "node:test";
import { marks, range } from "../src/parts/plot";
import { column } from "../src/views/diagnose/columns";
import { parseFile, textToSend, split, tracks, defaultColumns } from "../src/views/diagnose/parseFile";
import { splitAt } from "../src/views/diagnose/trialViewer";
import { extentOfTrials, type Report, trajectoryOf } from "../src/views/diagnose/report";
import { sceneOfTrial } from "../src/views/diagnose/sceneOfTrial";
import { requestBody, columnsOf, emptySetup, guessReading, missingInput, pixelSizeFromGravity, tracksOf } from "../src/views/diagnose/setup";
import { summarise, readTracks, NO_OPTIONS, typicalBounceHeight } from "../src/views/diagnose/tracks";
import { judgeFit } from "../src/parts/fitQuality";
import { curlCommand, pythonCode } from "../src/parts/exportCode";
import { withActionSpace } from "../src/views/diagnose/extendedWorld";
import { fitJudgements } from "../src/views/diagnose/messages";
import { readingSummary } from "../src/views/diagnose/readingSummary";
import { SAMPLE_DRAG_PER_M, sampleCsv } from "../src/views/diagnose/sample";
import { stagesOf, startOf } from "../src/views/diagnose/stages";
import { trialName } from "../src/views/diagnose/trialName";
import { trialsCsv } from "../src/views/diagnose/trialsCsv";

/** Names and what the server takes them for (src/reality/columns.rs has the same list). */
test("column names are recognised as by the server", () => {
  const cases: [string, string | null, string | null, string | null][] = [
    ["t", "time", null, null],
    ["Time (s)", "time", "s", null],
    ["time_ms", "time", "ms", null],
    ["Milliseconds", "time", "ms", null],
    ["\ufeffframe", "frame", null, null],
    ["Frame Number", "frame", null, null],
    ["X [m]", "x", "m", null],
    ["y (CM)", "y", "cm", null],
    ["x/mm", "x", "mm", null],
    ["pos_x", "x", null, null],
    ["Position Y (px)", "y", "px", null],
    ["x_px", "x", "px", null],
    ["pixely", "y", "px", null],
    ["Ball/0/X", "x", null, "Ball/0"],
    ["P1_y", "y", null, "P1"],
    ["A_x", "x", null, "A"],
    ["track_id", "trial", null, null],
    ["object", "body", null, null],
  ];
  for (const [name, quantity, unit, track] of cases) {
    const parsed = column(name);
    assert.deepEqual([parsed.quantity, parsed.unit?.name ?? null, parsed.track], [quantity, unit, track], name);
  }
  for (const name of ["", "Unnamed: 0", "step", "v_x", "v_{x}", "vx", "a.y", "r", "θr", "angle", "x (s)", "t [m]", "xy", "unused3"]) {
    assert.equal(column(name).quantity, null, name);
  }
});

/** A parabola in cells: 20 samples a launch. */
function fall(head: string, row: (t: number, y: number) => string, launches = 1): string {
  const rows = Array.from({ length: 20 * launches }, (_, i) => {
    const t = 0.02 * (i % 20);
    return row(t, 1 + t - 0.5 * 9.81 * t * t);
  });
  return [head, ...rows].join("\n");
}

test("files are split at any separator, with their preamble", () => {
  assert.deepEqual(split('"1,5",2', ","), ["1,5", "2"]);
  const files = [
    fall("t,x,y", (t, y) => `${t},0,${y}`),
    `\ufeffmass A\n${fall("t;x;y", (t, y) => `${t};0;${y}`).replaceAll(".", ",")}`,
    fall("#T X_m Y_m", (t, y) => `${t} 0 ${y}`),
    fall("Time (ms)\tx (mm)\ty (mm)", (t, y) => `${t * 1e3}\t0\t${y * 1e3}`).replaceAll("\n", "\r\n"),
  ];
  for (const text of files) {
    const file = parseFile("a.csv", text);
    const [track] = readTracks(file, defaultColumns(file), NO_OPTIONS);
    assert.equal(track!.trial, "a");
    assert.equal(track!.t.length, 20, text.slice(0, 20));
    assert.ok(Math.abs(summarise([track!]).upwardAcceleration! + 9.81) < 1e-3, text.slice(0, 20));
  }
  assert.equal(parseFile("b", "hello world").hasHeader, false);
});

test("one of several tracks is read, and manually selected columns are written to the header of the request", () => {
  const two = parseFile("k.csv", "Time;Ball/0/X;Ball/0/Y;Hand/0/X;Hand/0/Y\n0;1;2;3;4\n1;2;3;4;5");
  assert.deepEqual(tracks(two), ["Ball/0", "Hand/0"]);
  assert.equal(defaultColumns(two, "hand/0").x, 3);
  const odd = parseFile("o.csv", "when,left,height\n0,1,2\n1,2,3");
  const chosen = { clock: 0, x: 1, y: 2, z: -1, trial: -1, body: -1 };
  assert.equal(textToSend(odd, chosen), "t,x,y\n0,1,2\n1,2,3");
  assert.deepEqual(defaultColumns(parseFile("o.csv", textToSend(odd, chosen))), chosen);
  const plainFile = parseFile("p.csv", "t,x,y\n0,1,2");
  assert.equal(textToSend(plainFile, defaultColumns(plainFile)), "t,x,y\n0,1,2");
  const both = parseFile("q.csv", "frame,t (s),x_px,y_px,x (cm),y (cm)\n0,0,1,2,3,4");
  assert.equal(textToSend(both, { ...defaultColumns(both), clock: 0 }), "frame,unused1,unused2,unused3,x_cm,y_cm\n0,0,1,2,3,4");
});

test("a setup requires what the file lacks, and guesses settings from the data", () => {
  const setup = { ...emptySetup(), files: [parseFile("a.csv", fall("frame,x_px,y_px", (t, y) => `${t / 0.02},0,${-y / 0.002}`))] };
  assert.match(missingInput(setup)!, /pixels/);
  assert.equal(guessReading(setup).length, 1);
  assert.equal(setup.reading.yDown, true);
  setup.reading.fps = 50;
  assert.ok(Math.abs(pixelSizeFromGravity(setup)! - 0.002) < 1e-6);
  setup.reading.metresPerPixel = 0.002;
  assert.equal(missingInput(setup), null);
  assert.ok(Math.abs(summarise(tracksOf(setup)).upwardAcceleration! + 9.81) < 1e-6);
  const body = requestBody(setup);
  assert.deepEqual(body.reading, { fps: 50, metres_per_pixel: 0.002, y_down: true });
  assert.deepEqual(body.ball, { radius: 0.02, gravity: 9.81 });
  assert.equal(columnsOf(setup, setup.files[0]!).clock, 0);
  const silent = { ...emptySetup(), files: [parseFile("a.csv", fall("t,x,y", (t, y) => `${t},0,${y}`))] };
  assert.deepEqual(guessReading(silent), []);
  assert.equal("reading" in requestBody(silent), false);
});

test("the floor is estimated from bounces, and free flights have none", () => {
  const rows = (id: number): string[] => {
    const height = (t: number): number => 0.02 + Math.abs(((t + 0.013 * id) % 0.5) - 0.25) * 4;
    return Array.from({ length: 60 }, (_, i) => `${id},${i / 100},0,${height(i / 100)}`);
  };
  const file = parseFile("b.csv", ["trial,t,x,y", ...rows(0), ...rows(1), ...rows(2)].join("\n"));
  assert.ok(Math.abs(typicalBounceHeight(readTracks(file, defaultColumns(file), NO_OPTIONS))! - 0.02) < 1e-9);
  const air = parseFile("c.csv", fall("trial,t,x,y", (t, y) => `1,${t},0,${y}`));
  assert.equal(typicalBounceHeight(readTracks(air, defaultColumns(air), NO_OPTIONS)), null);
});

const columns = ["t", "body", "stretch", "x", "y", "before_x", "before_y", "after_x", "after_y", "sd_before_x", "sd_before_y", "sd_after_x", "sd_after_y"];

function report(): Report {
  const row = (t: number, stretch: number): (number | null)[] => [t, 0, stretch, 3 * t + 0.1, 1 + 2 * t - 5 * t * t, 0.5, 0, 0.1, 0, null, null, 0.01, 0.01];
  const scene = { format: "iplw.scene/1", name: "one ball", bodies: [{ name: "ball", shape: { type: "disc", radius: 0.02 } }] };
  const result = { verdict: "named", effects: [{ name: "quadratic_drag", acts_on: "motion", probability: 1, parameters: [] }], rivals: [["quadratic_drag"]], launches: [{ trial: 4, name: "a", setting: null, sizes: [] }], paths: { columns, launches: [{ trial: 4, rows: [row(0, 0), row(0.1, 0), row(0.3, 0), row(0.4, 1)] }] }, extended_scene: scene, next_scene: null, evidence: {} };
  return result as unknown as Report;
}

test("a trial's trajectory includes both models, and initialises the extended scene", () => {
  const trajectory = trajectoryOf(report().paths, 4)!;
  assert.deepEqual(trajectory.starts, [3]);
  assert.ok(Math.abs(trajectory.after.at[1]![0] - 0.3) < 1e-12 && Math.abs(trajectory.before.at[0]![0] + 0.4) < 1e-12);
  assert.ok(Number.isNaN(trajectory.before.sd[0]![0]));
  assert.deepEqual(splitAt(trajectory.t, trajectory.starts), [[0, 0.1, 0.3], [0.4]]);
  assert.equal(trajectoryOf(report().paths, 9), null);
  const { position, velocity } = sceneOfTrial(report(), 4)!.bodies[0]!;
  assert.deepEqual(position!.map((v) => Number(v.toFixed(9))), [0, 1]);
  assert.deepEqual(velocity!.map((v) => Number(v.toFixed(9))), [3, 2]);
  // Of another setting: its mass, and what the effect is there.
  const modified = report();
  modified.launches[0]!.setting = "light";
  const of = (setting: string, value: number) => ({ name: "k", value, setting });
  modified.effects[0]!.parameters = [of("heavy", 0.1), of("light", 0.3)];
  Object.assign(modified.extended_scene!, { effects: [{ name: "quadratic_drag", parameters: { k: 0.1 } }], settings: { light: { bodies: { ball: { mass: 0.01 } } } } });
  const scene = sceneOfTrial(modified, 4)!;
  assert.equal(scene.bodies[0]!.mass, 0.01);
  assert.deepEqual(scene.effects, [{ name: "quadratic_drag", parameters: { k: 0.3 } }]);
  assert.equal(scene.settings, undefined);
  // A setting of one trial has the trial's initial state.
  modified.launches[0]!.name = "light";
  Object.assign(modified.extended_scene!, { settings: { light: { bodies: { ball: { position: [7, 8] } } } } });
  const own = sceneOfTrial(modified, 4)!.bodies[0]!;
  assert.deepEqual([own.position, own.velocity], [[7, 8], undefined]);
  const [left, bottom, right, top] = extentOfTrials(modified)!;
  assert.ok(left < 0.1 && right > 1.3 && bottom < 1 && top > 1.15);
});

test("a fit is judged by its error beside the noise", () => {
  assert.deepEqual([0.00105, 0.0025, 0.0032].map((e) => judgeFit("It", e, 0.001).level), ["good", "warn", "bad"]);
  assert.equal(judgeFit("The model", 0.0032, 0.001).text, "The model does not fit: error 3.2 times the noise (3.2 mm beside 1 mm of noise)");
  assert.equal(judgeFit("It", 0.0015, 0.001, true).level, "good");
  assert.equal(judgeFit("It", 0.00101, 0.001, false).level, "warn");
  const gain = { held_out: { base_rmse: 0.07, extended_rmse: 0.002, floor_rmse: 0.002 } };
  const both = fitJudgements({ ...report(), gain, residual: null });
  assert.deepEqual(both.map((j) => j.level), ["bad", "good"]);
  assert.match(both[1]!.text, /^The simulation with quadratic drag explains the trials down to the noise/);
  assert.deepEqual(fitJudgements({ ...report(), verdict: "insufficient_data", gain: { held_out: null }, residual: null }).map((j) => j.level), ["open"]);
});

test("trials bear the names of the user", () => {
  assert.deepEqual(["7", "throw 7", "throw07.csv"].map(trialName), ["Trial 7", "throw 7", "throw07.csv"]);
});

test("the extended scene gets the measured launch velocities as its action space, and is exported as code", () => {
  const scene = sceneOfTrial(report(), 4)!;
  const { action } = withActionSpace(scene, report());
  assert.deepEqual(action!.components.map((c) => [c.target, c.set, c.low, c.high]), [["ball", "vx", 2.75, 3.25], ["ball", "vy", 1.75, 2.25]]);
  const own = { ...scene, action: { components: [] } };
  assert.equal(withActionSpace(own, report()), own);
  assert.match(pythonCode(scene, "http://a"), /client\.call\("simulate", scene=scene/);
  assert.match(curlCommand(scene, "http://a", true), /^curl -s http:\/\/a\/v1\/simulate .*\n.*IPLW_TOKEN/);
});

test("trials are written as CSV with the columns that they have", () => {
  const none = [null, null];
  const track = { x: [0, null], y: [1, null], angle: none, vx: none, vy: none, omega: none };
  const one = { trial: "throw, 1", setting: null, t: [0, 0.1], bodies: { ball: track } };
  assert.equal(trialsCsv([one]), 'trial,t,body,x,y\n"throw, 1",0,ball,0,1\n');
  assert.equal(trialsCsv([{ ...one, trial: "2", setting: "light", bodies: { ball: { ...track, vx: [3, 4] } } }]), "trial,setting,t,body,x,y,vx\n2,light,0,ball,0,1,3\n2,light,0.1,ball,,,4\n");
});

test("a log is read as stages with their durations and findings", () => {
  const texts = ["queued", "started", "reading the trials", "the noise is 1 mm", "trying single effects", "succeeded"];
  const lines = texts.map((text, i) => ({ number: i + 1, at: 10 + i, level: "info", text }));
  assert.deepEqual(stagesOf(lines), [
    { name: "reading the trials", begin: 12, end: 14, findings: ["the noise is 1 mm"] },
    { name: "trying single effects", begin: 14, end: 15, findings: [] },
  ]);
  assert.deepEqual([startOf(lines), startOf([])], [11, null]);
});

test("the sample is 14 throws with drag, and says how it is read", () => {
  const setup = { ...emptySetup(), files: [parseFile("sample.csv", sampleCsv())] };
  assert.deepEqual(guessReading(setup), []);
  assert.equal(readingSummary(setup), "Columns: t in s, x and y in m; +y is up; 14 trials by column “trial”.");
  const { upwardAcceleration, trials, samples } = summarise(tracksOf(setup));
  assert.deepEqual([trials, samples], [14, 560]);
  assert.ok(upwardAcceleration! < -8 && upwardAcceleration! > -10.5 && SAMPLE_DRAG_PER_M > 0, String(upwardAcceleration));
  assert.equal(sampleCsv(), sampleCsv());
});

test("three coordinates are projected on the vertical plane of each trial", () => {
  const text = fall("t,x,y,z", (t, height) => `${t},${(0.6 * 3 * t).toFixed(6)},${(0.8 * 3 * t).toFixed(6)},${height}`);
  const setup = { ...emptySetup(), files: [parseFile("s.csv", text)] };
  assert.deepEqual(guessReading(setup), []);
  const [track] = tracksOf(setup);
  assert.ok(Math.abs(track!.at.at(-1)![0] - 3 * 0.38) < 1e-4 && Math.abs(track!.at[0]![1] - 1) < 1e-9);
  assert.match(readingSummary(setup), /x, y and z in m; \+z is up/);
  setup.reading.up = "-z";
  assert.deepEqual(requestBody(setup).reading, { up: "-z" });
  assert.ok(Math.abs(tracksOf(setup)[0]!.at[0]![1] + 1) < 1e-9);
});

test("plots have round ticks within their range", () => {
  assert.deepEqual(marks(-0.2, 0.31, 6), [-0.2, -0.1, 0, 0.1, 0.2, 0.3]);
  assert.deepEqual(marks(1, 1, 5).length, 1);
  assert.deepEqual(range([3, Number.NaN, -1], [2]), [-1, 3]);
  assert.equal(range([]), null);
});

test("the estimated floor does not depend on the phase of a bounce between two samples", () => {
  const g = 9.81;
  for (let phase = 0; phase < 10; phase++) {
    // Falls from 0.5 m and comes back with 0.8 of its speed.
    const hit = Math.sqrt(1 / g) + 0.001 * phase;
    const height = (t: number): number => {
      const [u, v] = [t - hit, Math.sqrt(g)];
      return u < 0 ? -v * u - 0.5 * g * u * u : 0.8 * v * u - 0.5 * g * u * u;
    };
    const rows = [0, 1].flatMap((id) => Array.from({ length: 60 }, (_, i) => `${id},${i / 100},0,${height(i / 100)}`));
    const file = parseFile("b.csv", ["trial,t,x,y", ...rows].join("\n"));
    assert.ok(Math.abs(typicalBounceHeight(readTracks(file, defaultColumns(file), NO_OPTIONS))!) < 1e-6, `phase ${phase}`);
  }
});
