// Physics of a simulated world: latents and effects, as one world or as samples of a posterior.

import { api, ok, type Schema } from "../../api/client";
import { short } from "../../parts/slider";
import type { Scene } from "../../scene/types";
import { jobById } from "./kind";

export interface Physics {
  latents: Record<string, number>;
  effects: { name: string; parameters: Record<string, number> }[];
  /** A force field without a name, as effects. */
  field?: Physics["effects"];
}

/** The part of a posterior that plans and designs read. */
export interface ParameterSamples {
  format: string;
  columns: Record<string, (number | null)[]>;
  effects: Physics["effects"];
  discrepancy: ForceField[];
}

/** A sampled force field without a name: effects without their first two parameters, the amplitudes, which each sample has. */
interface ForceField {
  effects: Physics["effects"];
  /** Samples that have it, and the amplitudes of each, two for an effect. */
  draws: number[];
  amplitudes: number[][];
}

const LATENTS = ["density", "friction", "restitution"];

/** The part of a posterior that requests take. */
export function samplesOf(result: unknown): ParameterSamples {
  const { format, columns, effects, discrepancy } = result as ParameterSamples;
  return { format, columns, effects: effects ?? [], discrepancy: discrepancy ?? [] };
}

export function sampleCount(samples: ParameterSamples): number {
  return Object.values(samples.columns)[0]?.length ?? 0;
}

/** The world of one sample; without an index, the world of the means, which has no force field. */
export function physicsOf(samples: ParameterSamples, index: number | null, library: readonly Schema<"EffectOut">[]): Physics {
  const value = (column: (number | null)[]): number | null => {
    if (index !== null) return column[index] ?? null;
    const values = column.filter((v) => v !== null);
    // An effect that most samples lack is not part of the typical world.
    return values.length * 2 > column.length ? values.reduce((a, b) => a + b, 0) / values.length : null;
  };
  const physics = physicsFrom(Object.entries(samples.columns).map(([name, column]) => [name, value(column)]), samples.effects);
  return index === null ? physics : { ...physics, field: forceField(samples.discrepancy, index, library) };
}

/** The force field of a sample as effects. */
function forceField(fields: readonly ForceField[], index: number, library: readonly Schema<"EffectOut">[]): Physics["effects"] {
  return fields.flatMap((field) => {
    const amplitudes = field.amplitudes[field.draws.indexOf(index)];
    if (!amplitudes) return [];
    return field.effects.map(({ name, parameters }, k) => {
      const [first, second] = library.find((e) => e.name === name)?.parameters ?? [];
      return { name, parameters: { ...(first ? { [first.name]: amplitudes[2 * k] ?? 0 } : {}), ...(second ? { [second.name]: amplitudes[2 * k + 1] ?? 0 } : {}), ...parameters } };
    });
  });
}

/** Values by name: of a latent, or of an effect's parameter (`linear_drag.c`). */
export function physicsFrom(values: readonly (readonly [string, number | null])[], fixed: Physics["effects"] = []): Physics {
  const latents: Record<string, number> = {};
  const effects = new Map(fixed.map((e) => [e.name, { name: e.name, parameters: { ...e.parameters } }]));
  for (const [name, value] of values) {
    if (value === null) continue;
    const [effect = "", parameter] = name.split(".", 2);
    if (LATENTS.includes(name)) latents[name] = value;
    else if (parameter) {
      const term = effects.get(effect) ?? { name: effect, parameters: {} };
      term.parameters[parameter] = value;
      effects.set(effect, term);
    }
  }
  return { latents, effects: [...effects.values()] };
}

/** The estimates of an estimation as one world. */
export async function estimatePhysics(id: string, signal: AbortSignal): Promise<Physics> {
  const result = (await jobById(id, signal)).result as { latents?: Schema<"LatentEstimateOut">[]; effects?: Schema<"LatentEstimateOut">[] } | null;
  return physicsFrom([...(result?.latents ?? []), ...(result?.effects ?? [])].map((l) => [l.name, l.value]));
}

/** The prior means of a family. */
export async function priorPhysics(family: string, signal: AbortSignal): Promise<Physics> {
  const { data } = await api.GET("/v1/worlds/{id}", { params: { path: { id: `${family}-sim` } }, signal });
  const values = Object.entries(data?.latents ?? {}).map(([name, v]) => [name, v ?? null] as const);
  return physicsFrom(values);
}

/** Time between two samples of a film, s. */
const SAMPLE_INTERVAL_S = 1 / 60;

/** Simulates an action of a task. */
export function simulateAction(task: string, scene: Scene, action: readonly number[], physics: Physics, signal: AbortSignal): Promise<Schema<"SimulationOut">> {
  const observe_every = Math.max(1, Math.round(SAMPLE_INTERVAL_S / (scene.time_step ?? 1 / 240)));
  const body = { task, action: [...action], latents: physics.latents, effects: [...physics.effects, ...(physics.field ?? [])], observe_every, stop: false };
  return ok(api.POST("/v1/simulate", { body, signal }));
}

/** The physics in words. */
export function physicsText({ latents, effects, field }: Physics): string {
  const terms = effects.map((e) => `${e.name.replaceAll("_", " ")} (${Object.entries(e.parameters).map(([name, v]) => `${name} ${short(v)}`).join(", ")})`);
  const unnamed = field?.length ? ["an unnamed force field"] : [];
  return [...Object.entries(latents).map(([name, v]) => `${name} ${short(v)}`), ...terms, ...unnamed].join(", ") || "the scene's own values";
}
