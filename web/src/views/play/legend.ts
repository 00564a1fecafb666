// The legend of a scene: a row of what is visible, which unfolds into explanations.

import { h, put, s } from "../../dom";
import type { Scene } from "../../scene/types";
import type { ArrowScale } from "./arrows";

/** Content of a picture beyond bodies. */
export interface Visible {
  forbidden: boolean;
  contacts: boolean;
  /** Whether contact rings are as large as the speed of approach. */
  impact: boolean;
  simulated: boolean;
  real: boolean;
  compared: boolean;
  /** Whether trajectories have the colours of their worlds, and whether the simulation has effects. */
  worlds: boolean;
  extended: boolean;
  scales: readonly ArrowScale[];
}

interface Entry {
  label: string;
  about: string;
  sample: SVGElement[];
  /** Width of the sample, px. */
  width?: number;
}

const [WIDTH, HEIGHT] = [26, 16];

/** The legend; `show` replaces its entries. */
export function legend(scene: Scene): { element: HTMLElement; show: (visible: Visible) => void } {
  const [row, list] = [h("summary", {}), h("dl", {})];
  const element = h("details", { class: "legend" }, row, list);
  let before = "";
  const show = (visible: Visible): void => {
    const entries = [...goalEntries(scene), ...motionEntries(visible), ...markEntries(visible)];
    element.hidden = !entries.length;
    const now = JSON.stringify([entries.map((e) => [e.label, e.about, e.width]), visible.worlds, visible.extended]);
    if (now === before) return;
    before = now;
    put(row, h("span", { class: "unseen" }, "Legend: "), ...entries.map((e) => h("span", { class: "key" }, swatch(e), e.label)));
    put(list, ...entries.flatMap((e) => [h("dt", {}, e.label), h("dd", {}, e.about)]));
  };
  return { element, show };
}

function goalEntries(scene: Scene): Entry[] {
  const { goal } = scene;
  if (!goal) return [];
  const names = "bodies" in goal ? goal.bodies.join(" and ") : goal.body;
  const bodies = { label: "goal bodies", about: `Bodies of the goal have a thick outline: ${names}.`, sample: [s("circle", { class: "body solid wanted", cx: 13, cy: 8, r: 6, fill: "none" })] };
  if ("bodies" in goal) return [bodies];
  const region = { label: "goal region", about: `Where ${names} must get to.`, sample: [s("rect", { class: "goal", x: 2, y: 2, width: 22, height: 12 })] };
  return [region, { ...bodies, label: "goal body", about: `The body of the goal, ${names}, has a thick outline.` }];
}

function motionEntries({ simulated, real, compared, worlds, extended }: Visible): Entry[] {
  const path = (look: string): SVGElement => s("path", { class: look, d: "M1 12Q13 0 25 12", fill: "none", stroke: "currentColor" });
  const world = worlds ? `${extended ? "with effects" : "of the simulation"}` : "in the colour of each body";
  const entries: (Entry | false)[] = [
    simulated && { label: "simulated", about: `Solid: simulated trajectory, ${world}.`, sample: [path("trail")] },
    compared && { label: "compared", about: "Dotted: trajectory in the simulation compared with; its bodies are empty outlines.", sample: [path("trail other")] },
    real && { label: "measured", about: "Dashed with dots: trajectory in the real world, with a dot at every measurement; its bodies are pale with dashed outlines.", sample: [path("trail real"), s("circle", { class: "dot", cx: 13, cy: 6, r: 2.2 })] },
  ];
  return entries.filter((e) => e !== false);
}

function markEntries({ forbidden, contacts, impact, scales }: Visible): Entry[] {
  const size = impact ? "Its size is the speed of approach." : "Switch on Impact speed to see how fast.";
  const entries: (Entry | false)[] = [
    contacts && { label: "contact", about: `A ring at a body where it begins to touch something; red at that moment. ${size}`, sample: [s("circle", { class: "contact", cx: 13, cy: 8, r: impact ? 7 : 5 })] },
    forbidden && { label: "forbidden", about: "Positions at which the object cannot be placed: it would overlap something or leave the bounds.", sample: [s("rect", { class: "shade", x: 1, y: 1, width: 24, height: 14 })] },
  ];
  return [...entries.filter((e) => e !== false), ...scales.map(arrowEntry)];
}

function arrowEntry({ kind, value, length, unit }: ArrowScale): Entry {
  const end = length + 1;
  const figure = `${Number(value.toPrecision(2))} ${unit}`;
  const name = kind === "velocity" ? "velocity" : "force per mass";
  const sample = s("path", { class: `arrow ${kind}`, d: `M1 8H${end}M${end - 8} 4L${end} 8L${end - 8} 12` });
  const about = kind === "velocity" ? "Velocity of each body." : "Net force per mass, which is the acceleration; jumps at contacts are left out.";
  return { label: `${name}: ${figure}`, about: `${about} An arrow as long as this one is ${figure}.`, sample: [sample], width: Math.ceil(end + 2) };
}

function swatch({ sample, width = WIDTH }: Entry): SVGElement {
  return s("svg", { width, height: HEIGHT, viewBox: `0 0 ${width} ${HEIGHT}`, "aria-hidden": "true" }, s("g", { class: "scene" }, ...sample));
}
