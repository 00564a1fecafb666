// Code that simulates a scene from outside the page.

import { curlRequest, pythonProgram } from "../scene/code";
import type { Scene } from "../scene/types";

/** Python code that simulates the scene and prints where each body ends. */
export function pythonCode(scene: Scene, server: string): string {
  return pythonProgram(scene, server, "", [
    'film = client.call("simulate", scene=scene, stop=False)',
    'for name, track in film["bodies"].items():',
    '    print(name, film["t"][-1], track["x"][-1], track["y"][-1])',
  ]);
}

/** A curl command that simulates the scene. */
export function curlCommand(scene: Scene, server: string, token: boolean): string {
  return curlRequest(`${server}/v1/simulate`, '"stop": false, ', scene, token);
}
