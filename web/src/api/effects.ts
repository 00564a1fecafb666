// The library of effects.

import { all, api, ok, type Schema } from "./client";

/** All effects of the library. */
export function effectLibrary(signal: AbortSignal): Promise<Schema<"EffectOut">[]> {
  return all((cursor) => ok(api.GET("/v1/effects", { params: { query: cursor ? { cursor, limit: 1000 } : { limit: 1000 } }, signal })), (page) => page.effects);
}

/** Units of the parameters of effects, by their full name: `linear_drag.c`. */
export function parameterUnits(library: readonly Schema<"EffectOut">[]): Map<string, string> {
  return new Map(library.flatMap((e) => e.parameters.map((p) => [`${e.name}.${p.name}`, p.unit] as const)));
}
