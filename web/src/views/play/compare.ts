// The simulation compared with: choice, and its physics.

import { h, put, uniqueId } from "../../dom";
import type { SceneEffect } from "./sceneEffects";
import type { Physics } from "./simulation";

/** A simulation to compare with. */
export interface Comparison {
  title: string;
  physics: Physics;
}

export interface ComparisonChoice {
  element: HTMLElement;
  /** The comparison chosen, given the physics now; `null` for none. */
  current: (now: Physics) => Comparison | null;
}

const HELP = {
  none: "A second simulation beside this one, and their distance over time.",
  base: "The same action and latents without any effects, those of the scene and those added.",
  frozen: "Latents and effects as they were when chosen. Change them now to see the difference.",
} as const;

type Mode = keyof typeof HELP;

/** A select; `physics` returns the physics to freeze, `effects` are those of the scene. */
export function comparisonChoice(effects: readonly SceneEffect[], physics: () => Physics, onChange: () => void): ComparisonChoice {
  const [id, helpId] = [uniqueId("compare"), uniqueId("help")];
  const options: readonly (readonly [Mode, string])[] = [
    ["none", "nothing"],
    ["base", "the scene without its effects"],
    ["frozen", "the physics as set now (freeze)"],
  ];
  const select = h("select", { id, "aria-describedby": helpId }, ...options.map(([value, text]) => h("option", { value }, text)));
  const again = h("button", { type: "button", hidden: true }, "Freeze again");
  const help = h("p", { id: helpId, class: "help" }, HELP.none);
  let frozen: Physics | null = null;
  const freeze = (): void => {
    frozen = structuredClone(physics());
    onChange();
  };
  select.addEventListener("change", () => {
    const mode = select.value as Mode;
    put(help, HELP[mode]);
    again.hidden = mode !== "frozen";
    if (mode === "frozen") freeze();
    else onChange();
  });
  again.addEventListener("click", freeze);
  return {
    element: h("div", { class: "compare" }, h("div", { class: "row" }, h("label", { for: id }, "Compare with"), select, again), help),
    current: (now) => {
      if (select.value === "base") return { title: "Without effects", physics: { latents: now.latents, added: [], off: effects } };
      return select.value === "frozen" && frozen ? { title: "Frozen", physics: frozen } : null;
    },
  };
}
