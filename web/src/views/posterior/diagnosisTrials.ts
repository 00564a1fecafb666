// The trials of a diagnosis as a table for another request.

import { api, ok, type Schema } from "../../api/client";

type TrialsPage = Schema<"DiagnosisTrials">;
type Trial = TrialsPage["trials"][number];

/** Reads all trials of a diagnosis, with the scene of its base model. */
export async function diagnosisTrials(id: string, signal: AbortSignal): Promise<{ scene: TrialsPage["scene"]; trials: string }> {
  const trials: Trial[] = [];
  let scene: TrialsPage["scene"] | undefined;
  for (let cursor: string | undefined; ; ) {
    const page: TrialsPage = await ok(api.GET("/v1/diagnoses/{id}/trials", { params: { path: { id }, query: cursor ? { cursor } : {} }, signal }));
    scene ??= page.scene;
    trials.push(...page.trials);
    if (!page.next) return { scene, trials: tableOf(trials) };
    cursor = page.next;
  }
}

/** Trials as CSV with a row for each body and time; missing values are empty. */
export function tableOf(trials: readonly Trial[]): string {
  const settings = trials.some((trial) => trial.setting);
  const header = ["trial", ...(settings ? ["setting"] : []), "t", "body", "x", "y"].join(",");
  const rows = trials.flatMap((trial) =>
    Object.entries(trial.bodies).flatMap(([body, track]) =>
      trial.t.flatMap((t, i) => {
        const [x, y] = [track.x[i], track.y[i]];
        if (typeof x !== "number" || typeof y !== "number") return [];
        return [[quote(trial.trial), ...(settings ? [quote(trial.setting ?? "")] : []), t, quote(body), x, y].join(",")];
      }),
    ),
  );
  return [header, ...rows].join("\n");
}

function quote(text: string): string {
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
