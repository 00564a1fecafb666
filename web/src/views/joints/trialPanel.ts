// A recorded trial: the mechanism moves as measured, above curves of positions and commands.

import { h, put } from "../../dom";
import { choice } from "../../parts/field";
import { player } from "../../parts/player";
import { plot } from "../../parts/plot";
import type { Context } from "../../view";
import { type Mechanism, reach, unit } from "./mechanism";
import { mechanismPicture } from "./mechanismPicture";
import { type JointTrial, positionsAt } from "./recording";

/** The panel of a recording, with a choice of the trial. */
export function trialPanel(scene: Mechanism, trials: readonly JointTrial[], context: Context): HTMLElement {
  let trial = trials[0]!;
  const drawing = mechanismPicture(scene, reach(scene, trial.positions));
  const film = player((time) => drawing.show(positionsAt(trial, time)), context.signal);
  const curves = h("div", { class: "stack" });
  const show = (): void => {
    film.load(trial.t.at(-1)! - trial.t[0]!);
    film.seek(0);
    put(curves, ...figures(scene, trial, context.signal));
  };
  const names = trials.map((t) => [t.id, `Trial ${t.id} (${t.t.length} rows)`] as const);
  const pick = choice("Trial", names, trial.id, (id) => {
    trial = trials.find((t) => t.id === id) ?? trial;
    show();
  });
  show();
  return h("div", { class: "stack" }, pick.element, drawing.svg, film.element, curves);
}

/** Curves of positions and commands by joint. */
function figures(scene: Mechanism, trial: JointTrial, signal: AbortSignal): HTMLElement[] {
  const t = trial.t;
  const measured = scene.joints.map((joint) =>
    plot({ title: `${joint.name}: measured position`, x: "t (s)", y: unit(joint) }, [{ name: "measured", look: "dots", colour: "--measured", x: t, y: trial.positions[joint.name]! }], signal),
  );
  const commands = Object.entries(trial.commands).map(([joint, values]) =>
    plot({ title: `${joint}: command`, x: "t (s)", y: "command" }, [{ name: "command", look: "line", colour: "--simulated", x: t, y: values }], signal),
  );
  return [...measured, ...commands];
}
