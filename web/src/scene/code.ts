// A scene as JSON, and parts of the commands and programs that contain it.

import type { Scene } from "./types";

/** The scene as readable JSON with one line for each object. */
export function pretty(scene: Scene): string {
  const lines = Object.entries(scene).map(([name, value]) => `  ${JSON.stringify(name)}: ${field(value)}`);
  return `{\n${lines.join(",\n")}\n}\n`;
}

/** A curl command that posts the scene, after other `fields` of the body. The token is not copied: the command uses IPLW_TOKEN. */
export function curlRequest(address: string, fields: string, scene: Scene, token: boolean): string {
  const authorization = token ? `  -H "Authorization: Bearer $IPLW_TOKEN" \\\n` : "";
  const body = pretty(scene).trimEnd().replaceAll("'", `'\\''`);
  return `curl -s ${address} -H 'Content-Type: application/json' \\\n${authorization}  -d '{${fields}"scene": ${body}}'\n`;
}

/** A Python program that loads the scene and runs `lines` with a client; `resources` are opened after it. */
export function pythonProgram(scene: Scene, server: string, resources: string, lines: readonly string[]): string {
  // JSON cannot contain three quotes in a row: quotes within strings are escaped.
  return [
    "import json",
    "",
    "import iplw  # pip install iplw",
    "",
    `scene = json.loads(r"""${pretty(scene).trimEnd()}""")`,
    "",
    `with iplw.Client(${JSON.stringify(server)}) as client${resources}:  # a token: IPLW_TOKEN`,
    ...lines.map((line) => `    ${line}`),
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
