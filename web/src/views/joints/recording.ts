// Recordings of mechanisms: CSV with `trial`, `t`, a column for each joint, and `JOINT.command` for each motor.

import { FileError } from "../../api/problem";
import type { Mechanism } from "./mechanism";

export interface JointTrial {
  id: string;
  t: number[];
  /** By joint, rad or m. */
  positions: Record<string, number[]>;
  /** By the joint of the motor. */
  commands: Record<string, number[]>;
}

/** Parses a recording of a scene. The server checks it anew. */
export function parseRecording(name: string, text: string, scene: Mechanism): JointTrial[] {
  const [first = "", ...lines] = text.split(/\r?\n/).filter((line) => line.trim() !== "");
  const header = first.split(",").map((column) => column.trim());
  const joints = scene.joints.map((joint) => joint.name);
  const missing = ["trial", "t", ...joints].filter((column) => !header.includes(column));
  if (missing.length) throw new FileError(name, `it has no column ${missing.join(", ")}; a recording of this scene has the columns trial, t, ${joints.join(", ")}`);
  const at = (column: string): number => header.indexOf(column);
  const driven = joints.filter((joint) => header.includes(`${joint}.command`));
  const trials: JointTrial[] = [];
  lines.forEach((line, k) => {
    const cells = line.split(",");
    const number = (column: string): number => {
      const value = Number(cells[at(column)]);
      if (!Number.isFinite(value) || cells[at(column)]?.trim() === "") throw new FileError(name, `line ${k + 2} has no number in the column ${column}`);
      return value;
    };
    const id = cells[at("trial")]?.trim() ?? "";
    if (trials.at(-1)?.id !== id) trials.push({ id, t: [], positions: lists(joints), commands: lists(driven) });
    const trial = trials.at(-1)!;
    trial.t.push(number("t"));
    for (const joint of joints) trial.positions[joint]!.push(number(joint));
    for (const joint of driven) trial.commands[joint]!.push(number(`${joint}.command`));
  });
  if (!trials.length) throw new FileError(name, "it has no rows after the header");
  return trials;
}

/** Joint positions at a time, s: those of the last row before it. */
export function positionsAt(trial: JointTrial, time: number): Record<string, number> {
  const from = trial.t[0] ?? 0;
  const after = trial.t.findIndex((t) => t - from > time);
  const row = after < 0 ? trial.t.length - 1 : Math.max(0, after - 1);
  return Object.fromEntries(Object.entries(trial.positions).map(([joint, all]) => [joint, all[row] ?? 0]));
}

function lists(names: readonly string[]): Record<string, number[]> {
  return Object.fromEntries(names.map((name) => [name, [] as number[]]));
}
