// How a program gets into the Live view: snippets for Python and curl, and an example.

import { token } from "../../api/token";
import { h, put } from "../../dom";
import { copyText } from "../../parts/share";

/** A world that a program continues with, and an action of it; `null`: the program creates one. */
export interface GuideTarget {
  id: string;
  dimension: number;
}

/** Snippets for a world; `button` starts an example. */
export function guide(target: GuideTarget | null, button: HTMLElement | null): HTMLElement {
  const intro = target
    ? "Nothing has happened here since this page was opened. Start an episode and act in this world from any program:"
    : "A world appears here as soon as a program creates one, with Gymnasium or over HTTP, and every step can be watched:";
  return h(
    "div",
    { class: "guide stack" },
    h("p", {}, intro),
    h("div", { class: "snippets" }, snippet("Python", target ? pythonOf(target) : gymnasium()), snippet("curl", curlOf(target))),
    button ? h("div", { class: "row" }, button, h("span", { class: "soft" }, target ? "24 episodes, with actions that approach a solution" : "a simulated world, and 24 episodes with actions that approach a solution")) : null,
  );
}

function snippet(name: string, text: string): HTMLElement {
  const copy = h("button", { type: "button", class: "quiet", "aria-label": `Copy the ${name} example` }, "Copy");
  copy.addEventListener("click", () => {
    copyText(text)
      .then(() => put(copy, "Copied"))
      .catch(() => put(copy, "Not possible"));
    setTimeout(() => put(copy, "Copy"), 2_000);
  });
  return h("figure", { class: "snippet" }, h("figcaption", { class: "row between" }, h("strong", {}, name), copy), h("pre", { tabindex: 0, role: "region", "aria-label": `${name} example` }, h("code", {}, text)));
}

function gymnasium(): string {
  return `import gymnasium
import iplw  # registers the environments

env = gymnasium.make("iplw/Bowling-v0", world="sim",
                     url="${location.origin}")
for episode in range(50):
    env.reset()
    env.step(env.action_space.sample())`;
}

function pythonOf({ id, dimension }: GuideTarget): string {
  return `import iplw
import numpy as np

rng = np.random.default_rng(1)
with iplw.Client("${location.origin}") as client:
    world = client.world("${id}")
    for episode in range(50):
        world.reset()
        world.step(rng.random(${dimension}))`;
}

function curlOf(target: GuideTarget | null): string {
  const post = (path: string, body: string): string => `curl ${location.origin}${path} ${headers()}-d '${body}'`;
  const id = target?.id ?? "ID";
  const action = Array.from({ length: target?.dimension ?? 3 }, () => 0.5).join(", ");
  const create = target ? [] : [`${post("/v1/worlds", '{"task": "bowling"}')}\n# the response has the ID of the world`];
  return [...create, post(`/v1/worlds/${id}/reset`, "{}"), post(`/v1/worlds/${id}/step`, `{"action": [${action}]}`)].join("\n\n");
}

function headers(): string {
  const authorization = token() ? '-H "Authorization: Bearer $IPLW_TOKEN" \\\n  ' : "";
  return `\\\n  ${authorization}-H "Content-Type: application/json" \\\n  `;
}
