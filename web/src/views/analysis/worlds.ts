// The worlds in which the view of a job simulates: those that the address names.

import { effectLibrary } from "../../api/effects";
import { jobById } from "./kind";
import { estimatePhysics, type ParameterSamples, type Physics, physicsOf, priorPhysics, sampleCount, samplesOf } from "./physics";
import { worldOfAddress } from "./sampleSource";

/** A world to simulate in, and how to describe it. */
export interface World {
  physics: Physics;
  /** "the mean of the samples of job-8". */
  name: string;
}

/** A typical world and, of a posterior, its samples. */
export interface Worlds extends World {
  sample: ((index: number) => World) | null;
  count: number;
}

/** Reads the worlds from the address of a job; without any, the prior means of the family. `source`: that of the result. */
export async function worldsOf(query: URLSearchParams, family: string, source: string, signal: AbortSignal): Promise<Worlds> {
  const [posterior, estimation] = ["posterior", "estimation"].map((name) => query.get(name));
  if (posterior) return posteriorWorlds(posterior, samplesOf((await jobById(posterior, signal)).result), signal);
  const single = (physics: Physics, name: string): Worlds => ({ physics, name, sample: null, count: 1 });
  if (estimation) return single(await estimatePhysics(estimation, signal), `the estimate of ${estimation}`);
  const prior = await priorPhysics(family, signal);
  const scene = worldOfAddress(query);
  if (scene && source === "point") return single(scene, "the scene's world");
  if (scene) return single({ ...prior, effects: scene.effects }, "the prior means and the scene's effects");
  return single(prior, source === "prior" ? "the prior means" : `the prior means, because the address does not name the ${source === "point" ? "world" : "posterior"} of this job`);
}

async function posteriorWorlds(id: string, samples: ParameterSamples, signal: AbortSignal): Promise<Worlds> {
  const count = sampleCount(samples);
  const hasField = samples.discrepancy.length > 0;
  const library = hasField ? await effectLibrary(signal) : [];
  const sample = (index: number): World => ({ physics: physicsOf(samples, index, library), name: `sample ${index + 1} of ${count} of ${id}` });
  // The mean of force fields is not typical of them.
  const typical = hasField ? sample(0) : { physics: physicsOf(samples, null, library), name: `the mean of the samples of ${id}` };
  return { ...typical, sample, count };
}
