// Fields of the joints of a mechanism: what the simulation assumes about each.

import { h } from "../../dom";
import { numeric } from "../../parts/field";
import { type Joint, type Mechanism, unit } from "./mechanism";

/** A table of fields for all joints; `onChange` is called after a joint has changed. */
export function jointForm(scene: Mechanism, onChange: () => void): HTMLElement {
  return h("div", { class: "stack" }, ...scene.joints.map((joint) => fields(joint, scene, onChange)));
}

function fields(joint: Joint, scene: Mechanism, onChange: () => void): HTMLElement {
  const isHinge = joint.kind === "revolute";
  const torque = isHinge ? "N m" : "N";
  const spring = (): NonNullable<Joint["spring"]> => (joint.spring ??= { stiffness: 0, damping: 0, rest: 0 });
  const number = (label: string, units: string, value: number, keep: (value: number) => void): HTMLElement => {
    const changed = (now: number | null): void => {
      keep(now ?? 0);
      onChange();
    };
    return numeric(label, units, value, changed).element;
  };
  const motor = scene.motors?.find((m) => m.joint === joint.name);
  const effects = joint.effects?.length ? `Effects: ${joint.effects.map((e) => e.name.replaceAll("_", " ")).join(", ")}.` : "No effects.";
  return h(
    "fieldset",
    { class: "joint" },
    h("legend", {}, `${joint.name} (${isHinge ? "hinge" : "slide"}${motor ? `, ${motor.control} motor` : ""})`),
    h(
      "div",
      { class: "row" },
      number("Initial position", unit(joint), joint.position ?? 0, (v) => (joint.position = v)),
      number("Armature", isHinge ? "kg m²" : "kg", joint.armature ?? 0, (v) => (joint.armature = v)),
      number("Spring stiffness", isHinge ? "N m/rad" : "N/m", joint.spring?.stiffness ?? 0, (v) => (spring().stiffness = v)),
      number("Spring damping", isHinge ? "N m s/rad" : "N s/m", joint.spring?.damping ?? 0, (v) => (spring().damping = v)),
      motor ? number("Motor limit", torque, motor.max_torque ?? 0, (v) => (motor.max_torque = v)) : null,
    ),
    h("p", { class: "soft" }, effects),
  );
}
