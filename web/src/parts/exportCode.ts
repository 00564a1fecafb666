// Code that simulates the extended scene from outside the page.

import type { Scene } from "../scene/types";
import { pretty } from "../views/make/export";

/** Python code that simulates the scene and prints where each body ends. */
export function pythonCode(scene: Scene, server: string): string {
  return [
    "import json",
    "",
    "import iplw  # pip install iplw",
    "",
    `scene = json.loads(r"""${pretty(scene).trimEnd()}""")`,
    "",
    `with iplw.Client(${JSON.stringify(server)}) as client:  # a token: IPLW_TOKEN`,
    '    film = client.call("simulate", scene=scene, stop=False)',
    '    for name, track in film["bodies"].items():',
    '        print(name, film["t"][-1], track["x"][-1], track["y"][-1])',
    "",
  ].join("\n");
}

/** A curl command that simulates the scene. The token is not copied: the command uses IPLW_TOKEN. */
export function curlCommand(scene: Scene, server: string, token: boolean): string {
  const authorization = token ? `  -H "Authorization: Bearer $IPLW_TOKEN" \\\n` : "";
  const body = pretty(scene).trimEnd().replaceAll("'", `'\\''`);
  return `curl -s ${server}/v1/simulate -H 'Content-Type: application/json' \\\n${authorization}  -d '{"stop": false, "scene": ${body}}'\n`;
}
