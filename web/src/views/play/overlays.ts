// Switches of what is drawn over a film; remembered in this tab.

import { h } from "../../dom";

export interface Overlays {
  velocity: boolean;
  force: boolean;
  impact: boolean;
}

const KEY = "iplw-play-overlays";
const SWITCHES: readonly (readonly [keyof Overlays, string, string])[] = [
  ["velocity", "Velocity", "Arrows along the velocity of each body"],
  ["force", "Force per mass", "Arrows along the net force per mass, which is the acceleration; jumps at contacts are left out"],
  ["impact", "Impact speed", "Contact rings as large as the speed of approach"],
];

/** A row of checkboxes; `onChange` gets the overlays after every change. */
export function overlaySwitches(onChange: (overlays: Overlays) => void): { element: HTMLElement; overlays: Overlays } {
  const overlays: Overlays = { velocity: false, force: false, impact: false, ...stored() };
  const boxes = SWITCHES.map(([key, label, about]) => {
    const input = h("input", { type: "checkbox", checked: overlays[key] });
    input.addEventListener("change", () => {
      overlays[key] = input.checked;
      sessionStorage.setItem(KEY, JSON.stringify(overlays));
      onChange(overlays);
    });
    return h("label", { class: "check", title: about }, input, label);
  });
  return { element: h("fieldset", { class: "overlays" }, h("legend", {}, "Show"), ...boxes), overlays };
}

function stored(): Partial<Overlays> {
  try {
    return JSON.parse(sessionStorage.getItem(KEY) ?? "{}") as Partial<Overlays>;
  } catch {
    return {};
  }
}
