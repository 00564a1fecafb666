// A mechanism as a picture: its bodies, and marks of hinges, slides and motors.

import { put, s } from "../../dom";
import { picture } from "../../scene/draw";
import type { Box, Scene } from "../../scene/types";
import { frames, type Mechanism, poses } from "./mechanism";

/** The picture of a mechanism; `show` moves its joints. */
export function mechanismPicture(scene: Mechanism, box: Box): { svg: SVGSVGElement; show: (positions: Readonly<Record<string, number>>) => void } {
  const drawing = picture(scene as unknown as Scene, `The mechanism ${scene.name ?? ""}`, box);
  const size = 0.012 * Math.max(box[2] - box[0], box[3] - box[1]);
  const show = (positions: Readonly<Record<string, number>>): void => {
    drawing.pose("solid", poses(scene, positions));
    const all = frames(scene, positions);
    const marks = scene.joints.flatMap((joint) => {
      const [x, y] = all.get(joint.name)!.origin;
      const title = s("title", {}, `${joint.name}: ${joint.kind}${scene.motors?.some((m) => m.joint === joint.name) ? ", with a motor" : ""}`);
      const driven = scene.motors?.some((m) => m.joint === joint.name);
      const ring = driven ? [s("circle", { class: "joint-motor", cx: x, cy: y, r: 2 * size })] : [];
      if (joint.kind === "revolute") return [...ring, s("circle", { class: "joint-mark", cx: x, cy: y, r: size }, title)];
      const [ax, ay] = joint.axis ?? [1, 0];
      const [dx, dy] = [4 * size * ax, 4 * size * ay];
      return [...ring, s("line", { class: "joint-mark", x1: x - dx, y1: y - dy, x2: x + dx, y2: y + dy }, title)];
    });
    put(drawing.over, ...marks);
  };
  show({});
  return { svg: drawing.svg, show };
}
