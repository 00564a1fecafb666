// Trials of a diagnosis as CSV, in the format of the server.

import type { Schema } from "../../api/client";

type Trial = Schema<"DiagnosisTrialOut">;

const STATES = ["x", "y", "angle", "vx", "vy", "omega"] as const;

/** `trial,t,body,x,y` and the columns that some trial has. */
export function trialsCsv(trials: readonly Trial[]): string {
  const tracks = trials.flatMap((t) => Object.values(t.bodies));
  const states = STATES.filter((s) => s === "x" || s === "y" || tracks.some((b) => b[s]?.some((v) => typeof v === "number")));
  const hasSettings = trials.some((t) => t.setting);
  const head = ["trial", ...(hasSettings ? ["setting"] : []), "t", "body", ...states];
  const rows = trials.flatMap(({ trial, setting, t, bodies }) =>
    t.flatMap((time, k) =>
      Object.entries(bodies)
        .map(([body, track]) => [body, states.map((s) => track[s]?.[k] ?? null)] as const)
        .filter(([, values]) => values.some((v) => v !== null))
        .map(([body, values]) => [trial, ...(hasSettings ? [setting ?? ""] : []), time, body, ...values.map((v) => v ?? "")].map(cell).join(",")),
    ),
  );
  return [head.join(","), ...rows, ""].join("\n");
}

function cell(value: string | number): string {
  const text = String(value);
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
