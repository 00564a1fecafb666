// The drawing tools.

import { type Box, type Component, type Point, type Scene } from "../../scene/types";
import { hull, round, rounded } from "./shapes";
import { addObject, recentred, setComponents, isBody, objectAt } from "./objects";

export type Tool = "select" | "disc" | "box" | "polygon" | "segment" | "goal" | "area" | "bounds";

/** The tools, in the order of the toolbar. */
export const TOOLS: readonly { tool: Tool; title: string; key: string; hint: string }[] = [
  { tool: "select", title: "Select", key: "v", hint: "Click an object to select it, drag to move it; drag the background to move the view." },
  { tool: "disc", title: "Disc", key: "d", hint: "Drag from the centre outwards; Enter draws one in the middle of the view." },
  { tool: "box", title: "Box", key: "b", hint: "Drag from corner to corner; Enter draws one in the middle of the view." },
  { tool: "polygon", title: "Polygon", key: "p", hint: "Click the corners, then double-click or press Enter; the result is their convex hull." },
  { tool: "segment", title: "Segment", key: "s", hint: "Drag from end to end; Enter draws one in the middle of the view." },
  { tool: "goal", title: "Goal region", key: "g", hint: "Drag the region that a body's centre must reach; Enter draws one in the middle of the view." },
  { tool: "area", title: "Action area", key: "a", hint: "Drag the area where the action may place the selected object; Enter draws one in the middle of the view." },
  { tool: "bounds", title: "Bounds", key: "w", hint: "Drag the rectangle that placed objects must stay in; Enter uses the visible area." },
];

/** Why a tool drew nothing. */
export function emptyDrawingMessage(scene: Scene, tool: Tool): string {
  if (tool === "bounds" && !scene.action) return "Bounds belong to the action: draw an action area first.";
  if (tool === "goal" && !scene.bodies.length) return "Draw a body first: the goal region is for its centre.";
  if (tool === "area" && !scene.bodies.length) return "Draw an object first: the action area is for placing it.";
  return "Nothing was drawn: it has no size.";
}

/** A scene after a gesture, with the new selection. */
export interface DrawingResult {
  scene: Scene;
  place: string;
}

/** Draws by a drag from one point to another; `moving`: draws bodies. `view`: visible box, m. */
export function drawShape(scene: Scene, tool: Tool, from: Point, to: Point, moving: boolean, view: Box, selected: string): DrawingResult | null {
  const box: Box = [Math.min(from[0], to[0]), Math.min(from[1], to[1]), Math.max(from[0], to[0]), Math.max(from[1], to[1])];
  const [w, h] = [round((box[2] - box[0]) / 2), round((box[3] - box[1]) / 2)];
  const centre = rounded([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]);
  switch (tool) {
    case "disc": {
      const radius = round(Math.hypot(to[0] - from[0], to[1] - from[1]));
      return radius > 0 ? addObject(scene, { name: "disc", shape: { type: "disc", radius }, position: rounded(from) }, moving) : null;
    }
    case "box":
      return w > 0 && h > 0 ? addObject(scene, { name: "box", shape: { type: "box", half_width: w, half_height: h }, position: centre }, moving) : null;
    case "segment": {
      if (from[0] === to[0] && from[1] === to[1]) return null;
      // A body must have a thickness.
      const radius = moving ? round((view[2] - view[0]) * SEGMENT_RADIUS_SHARE) : 0;
      return addObject(scene, recentred({ name: "segment", shape: { type: "segment", from, to, radius } }), moving);
    }
    case "goal":
      return w > 0 && h > 0 && scene.bodies.length ? { scene: goal(scene, box, selected), place: "goal" } : null;
    case "area":
      return w > 0 || h > 0 ? area(scene, box, selected) : null;
    case "bounds":
      return w > 0 && h > 0 && scene.action ? { scene: { ...scene, action: { ...scene.action, bounds: box.map(round) as Box } }, place: "action" } : null;
    default:
      return null;
  }
}

/** Draws a polygon from clicked points. */
export function drawPolygon(scene: Scene, corners: readonly Point[], moving: boolean): DrawingResult | null {
  const vertices = hull(corners);
  return vertices.length < 3 ? null : addObject(scene, recentred({ name: "polygon", shape: { type: "polygon", vertices } }), moving);
}

/** Draws a default size at a point: for a click, and for the keyboard. */
export function drawDefault(scene: Scene, tool: Tool, at: Point, moving: boolean, view: Box, selected: string, step: number): DrawingResult | null {
  const r = Math.max(step, Math.round((view[2] - view[0]) / 20 / step) * step);
  const around = (w: number, h: number): DrawingResult | null => drawShape(scene, tool, [at[0] - w, at[1] - h], [at[0] + w, at[1] + h], moving, view, selected);
  if (tool === "disc") return drawShape(scene, tool, at, [at[0] + r, at[1]], moving, view, selected);
  if (tool === "polygon") return drawPolygon(scene, [[at[0] - r, at[1] - r], [at[0] + r, at[1] - r], [at[0], at[1] + r]], moving);
  if (tool === "segment") return around(4 * r, 0);
  if (tool === "bounds") return drawShape(scene, tool, [view[0], view[1]], [view[2], view[3]], moving, view, selected);
  return tool === "box" ? around(r, r) : around(2 * r, r);
}

/** Radius of a segment that is a body, share of the view's width. */
const SEGMENT_RADIUS_SHARE = 0.006;

function goal(scene: Scene, [left, bottom, right, top]: Box, selected: string): Scene {
  const region = ([[left, bottom], [right, bottom], [right, top], [left, top]] as Point[]).map(rounded);
  if (scene.goal?.type === "inside") return { ...scene, goal: { ...scene.goal, region } };
  const body = (isBody(selected) ? objectAt(scene, selected)?.name : undefined) ?? scene.bodies[0]?.name ?? "";
  return { ...scene, goal: { type: "inside", body, region } };
}

function area(scene: Scene, [left, bottom, right, top]: Box, selected: string): DrawingResult | null {
  const target = (objectAt(scene, selected) ?? scene.bodies[0])?.name;
  if (target === undefined) return null;
  const position: Component[] = [
    { target, set: "x", low: round(left), high: round(right) },
    { target, set: "y", low: round(bottom), high: round(top) },
  ];
  return { scene: position.reduce(withComponent, scene), place: "action" };
}

/** The scene with an action component, which replaces the one with the same target and quantity. */
export function withComponent(scene: Scene, component: Component): Scene {
  const action = scene.action ?? { components: [] };
  const index = action.components.findIndex((c) => c.target === component.target && c.set === component.set);
  const list = index < 0 ? [...action.components, component] : action.components.map((c, i) => (i === index ? { ...c, ...component } : c));
  return setComponents({ ...scene, action }, list);
}
