// A scene as SVG in metres with y up. Line widths are independent of the scale.

import { type Attributes, put, s, set } from "../dom";
import { colours } from "./colour";
import type { Body, Box, Point, Pose, Scene, Shape } from "./types";
import { halfPlane, goalLine, sceneExtent } from "./extent";

/** Styles of movable bodies: simulated, measured, of the simulation compared with, and where they cannot be placed. */
export type Look = "solid" | "ghost" | "other" | "refused";

const LOOKS: readonly Look[] = ["other", "ghost", "solid", "refused"];
/** Half planes are drawn beyond the box by this many times its size: the element may be wider than the box. */
const HALF_PLANE_SHARE = 2;

/** A picture of a scene with groups for additional elements. */
export interface Picture {
  svg: SVGSVGElement;
  /** Group below the bodies, in world coordinates, m, y up. */
  under: SVGGElement;
  /** Group above the bodies. */
  over: SVGGElement;
  box: Box;
  /** Shows another part of the world. */
  frame: (box: Box) => void;
  /** Moves bodies; bodies without a pose are hidden. */
  pose: (look: Look, poses: ReadonlyMap<string, Pose>) => void;
  /** Draws another scene in the same box. */
  redraw: (scene: Scene) => void;
  /** World coordinates of a screen position, m. */
  at: (event: { clientX: number; clientY: number }) => Point;
}

/** Draws a scene; bodies without a position are hidden until posed. */
export function picture(scene: Scene, label: string, box: Box = sceneExtent(scene)): Picture {
  const world = s("g", { transform: "scale(1 -1)" });
  const svg = s("svg", { class: "scene", role: "img", "aria-label": label }, world);
  const [fixed, under, over] = [s("g"), s("g"), s("g")];
  const layers: Record<Look, SVGGElement> = { other: s("g"), ghost: s("g"), solid: s("g"), refused: s("g") };
  put(world, fixed, under, ...LOOKS.map((look) => layers[look]), over);
  const bodies = new Map<Look, Map<string, SVGGElement>>();
  let current = scene;
  const still = (): void => void put(fixed, ...statics(current, beyond(drawing.box)), goal(current, beyond(drawing.box)));
  const frame = (now: Box): void => {
    drawing.box = now;
    if (isUnbounded(current)) still();
    set(svg, { viewBox: `${now[0]} ${-now[3]} ${now[2] - now[0]} ${now[3] - now[1]}` });
  };
  const redraw = (now: Scene): void => {
    current = now;
    still();
    for (const look of LOOKS) {
      const movable = movables(now, look);
      bodies.set(look, movable);
      put(layers[look], ...movable.values());
    }
    const starts = now.bodies.filter((b) => b.position);
    pose("solid", new Map(starts.map((b) => [b.name, { x: b.position![0], y: b.position![1], angle: b.angle ?? 0 }])));
    for (const look of LOOKS) if (look !== "solid") pose(look, new Map());
  };
  const pose = (look: Look, poses: ReadonlyMap<string, Pose>): void => {
    for (const [name, element] of bodies.get(look) ?? []) {
      const pose = poses.get(name);
      if (pose) set(element, { transform: `translate(${pose.x} ${pose.y}) rotate(${(pose.angle * 180) / Math.PI})` });
      element.setAttribute("visibility", pose ? "visible" : "hidden");
    }
  };
  const at = (event: { clientX: number; clientY: number }): Point => {
    const matrix = world.getScreenCTM();
    if (!matrix) return [0, 0];
    const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    return [p.x, p.y];
  };
  const drawing: Picture = { svg, under, over, box, frame, pose, redraw, at };
  frame(box);
  redraw(scene);
  return drawing;
}

/** A polyline, m. */
export function line(points: readonly Point[], attributes: Attributes): SVGPolylineElement {
  const text = points.map((p) => `${round(p[0])},${round(p[1])}`).join(" ");
  return s("polyline", { points: text, fill: "none", "vector-effect": "non-scaling-stroke", ...attributes });
}

/** Whether a part of the scene reaches to the edge of any box. */
function isUnbounded(scene: Scene): boolean {
  return scene.goal?.type === "above" || (scene.statics ?? []).some((object) => object.shape.type === "halfspace");
}

function beyond([left, bottom, right, top]: Box): Box {
  const more = HALF_PLANE_SHARE * Math.max(right - left, top - bottom);
  return [left - more, bottom - more, right + more, top + more];
}

function statics(scene: Scene, box: Box): SVGElement[] {
  const goalBodies = goalNames(scene);
  const placeable = new Set(scene.action?.components.map((c) => c.target));
  return (scene.statics ?? []).map((object) => {
    const look = { class: `static${goalBodies.has(object.name) ? " wanted" : ""}${placeable.has(object.name) ? " placeable" : ""}` };
    const place = object.shape.type === "halfspace" ? {} : { transform: transform(object) };
    return s("g", { ...place, "data-name": object.name }, ...shapeElements(object.shape, look, box));
  });
}

function goal(scene: Scene, box: Box): SVGElement | null {
  if (scene.goal?.type === "above") {
    const [[ax, ay], [bx, by]] = goalLine(scene.goal);
    const sign = bx < ax ? -1 : 1;
    const normal: Point = [sign * (by - ay), sign * (ax - bx)];
    const above = halfPlane(normal, normal[0] * ax + normal[1] * ay, box);
    return s("polygon", { class: "goal", points: points(above), "vector-effect": "non-scaling-stroke" });
  }
  if (scene.goal?.type !== "inside") return null;
  return s("polygon", { class: "goal", points: points(scene.goal.region), "vector-effect": "non-scaling-stroke" });
}

function movables(scene: Scene, look: Look): Map<string, SVGGElement> {
  const [bodyColours, goalBodies] = [colours(scene), goalNames(scene)];
  const object = (body: Body): SVGGElement => {
    const colour = bodyColours.get(body.name)!;
    const paint: Attributes = { class: `body ${look}${goalBodies.has(body.name) ? " wanted" : ""}`, fill: colour, stroke: colour };
    const spoke =
      body.shape.type === "disc"
        ? s("line", { class: `spoke ${look}`, x2: 0.82 * body.shape.radius, stroke: colour, "vector-effect": "non-scaling-stroke" })
        : null;
    return s("g", { "data-name": body.name, "data-look": look }, ...shapeElements(body.shape, paint, null), spoke);
  };
  return new Map(scene.bodies.map((body) => [body.name, object(body)]));
}

/** A shape in its own frame. */
function shapeElements(shape: Shape, paint: Attributes, box: Box | null): SVGElement[] {
  const common = { ...paint, "vector-effect": "non-scaling-stroke" };
  switch (shape.type) {
    case "disc":
      return [s("circle", { ...common, r: Math.max(0, shape.radius) })];
    case "box": {
      const [w, h] = [Math.max(0, shape.half_width), Math.max(0, shape.half_height)];
      return [s("rect", { ...common, x: -w, y: -h, width: 2 * w, height: 2 * h })];
    }
    case "polygon":
      return [s("polygon", { ...common, points: points(shape.vertices) })];
    case "segment": {
      const { from, to, radius = 0 } = shape;
      const ends = { x1: from[0], y1: from[1], x2: to[0], y2: to[1] };
      // Segments without a radius are drawn with the pen width.
      const thick = { ...paint, class: `${paint.class} thick`, stroke: paint.fill, "stroke-width": 2 * radius, "stroke-linecap": "round" };
      return [radius > 0 ? s("line", { ...thick, ...ends }) : s("line", { ...common, class: `${paint.class} thin`, ...ends })];
    }
    case "halfspace":
      return box ? [s("polygon", { ...common, points: points(halfPlane(shape.normal, shape.offset, box)) })] : [];
    case "compound":
      return shape.pieces.map((p) => s("g", { transform: transform(p) }, ...shapeElements(p, paint, box)));
  }
}

function goalNames(scene: Scene): Set<string> {
  if (!scene.goal) return new Set();
  return new Set("bodies" in scene.goal ? scene.goal.bodies : [scene.goal.body]);
}

function transform(placed: { position?: Point | null; angle?: number }): string {
  const [x, y] = placed.position ?? [0, 0];
  return `translate(${x} ${y}) rotate(${((placed.angle ?? 0) * 180) / Math.PI})`;
}

function points(list: readonly Point[]): string {
  return list.map((p) => p.join(",")).join(" ");
}

function round(v: number): number {
  return Math.round(v * 1e4) / 1e4;
}
