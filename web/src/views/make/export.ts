// Exports a scene as a file and as commands that create a world from it.

import type { Scene } from "../../scene/types";

/** The scene as readable JSON with one line for each object. */
export function pretty(scene: Scene): string {
  const lines = Object.entries(scene).map(([name, value]) => `  ${JSON.stringify(name)}: ${field(value)}`);
  return `{\n${lines.join(",\n")}\n}\n`;
}

/** A file name for the scene. */
export function filename(scene: Scene): string {
  const safe = (scene.name ?? "").replaceAll(/[^\p{L}\p{N}._-]+/gu, "-").replaceAll(/^[-.]+|-+$/g, "");
  return `${safe || "scene"}.json`;
}

/** A curl command that creates a world of the scene. The token is not copied: the command uses IPLW_TOKEN. */
export function curl(scene: Scene, server: string, token: boolean): string {
  const authorization = token ? `  -H "Authorization: Bearer $IPLW_TOKEN" \\\n` : "";
  const body = pretty(scene).trimEnd().replaceAll("'", `'\\''`);
  return `curl -s ${server}/v1/worlds -H 'Content-Type: application/json' \\\n${authorization}  -d '{"scene": ${body}}'\n`;
}

/** Python code that creates a world of the scene and makes a step. */
export function python(scene: Scene, server: string): string {
  // JSON cannot contain three quotes in a row: quotes within strings are escaped.
  return [
    "import json",
    "",
    "import iplw  # pip install iplw",
    "",
    `scene = json.loads(r"""${pretty(scene).trimEnd()}""")`,
    "",
    `with iplw.Client(${JSON.stringify(server)}) as client, client.create_world(scene=scene) as world:  # a token: IPLW_TOKEN`,
    "    world.reset(seed=1)",
    "    observation, reward, terminated, truncated, info = world.step([0.5] * world.dimension)",
    "    print(world.id, reward, info)",
    "",
  ].join("\n");
}

function field(value: unknown): string {
  const isObjectList = Array.isArray(value) && value.some((v) => typeof v === "object" && v !== null);
  if (!isObjectList) return inline(value);
  return `[\n${(value as unknown[]).map((v) => `    ${inline(v)}`).join(",\n")}\n  ]`;
}

function inline(value: unknown): string {
  if (Array.isArray(value)) return `[${value.map(inline).join(", ")}]`;
  if (typeof value !== "object" || value === null) return JSON.stringify(value);
  return `{${Object.entries(value)
    .filter(([, v]) => v !== undefined)
    .map(([name, v]) => `${JSON.stringify(name)}: ${inline(v)}`)
    .join(", ")}}`;
}
