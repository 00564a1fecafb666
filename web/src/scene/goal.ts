// The goal of a scene in words.

import type { Goal } from "./types";

/** A goal as a clause: "green and blue touch for 3 s". */
export function goalWords(goal: Goal): string {
  const hold = goal.hold_s ? ` for ${figure(goal.hold_s)} s` : "";
  switch (goal.type) {
    case "contact":
      return `${goal.bodies.join(" and ")} touch${hold}`;
    case "apart":
      return `${goal.bodies.join(" and ")} are apart${hold}${goal.after_touch ? ", after they have touched" : ""}`;
    case "inside":
      return `${goal.body} is in the goal region${hold}`;
    case "above": {
      const who = goal.point === "centre" ? `the centre of ${goal.body}` : goal.body;
      return `${who} is above ${goal.line ? "the goal line" : `${figure(goal.height ?? 0)} m`}${hold}`;
    }
  }
}

function figure(value: number): string {
  return String(Number(value.toPrecision(3)));
}
