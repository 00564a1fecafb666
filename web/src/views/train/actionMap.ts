// The actions that a policy ranks first on a task, as a map over the action space, next to the solutions in a simulation.

import { api, ok, type Schema } from "../../api/client";
import { uniqueId, h, put, s, set } from "../../dom";
import { latest } from "../../parts/latest";
import { picture, type Picture } from "../../scene/draw";
import { applyAction, targets, unit, valueAt } from "../../scene/action";
import type { Component, Point, Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { loadTask } from "../play/taskPicker";
import { columnCount, cellOf, bestByCell, type ActionGrid, actionGrid, cellBox, placementAxes, ranges, solvedByCell, strength, groupNearby } from "./actionGrid";
import { choice } from "./requestFields";
import { CHANCE } from "./scores";

/** Actions of a policy that are displayed; maximum of one request. */
const MAX_RANKED_ACTIONS = 10_000;
/** Actions simulated for the map of solutions: a few in each cell, in about a second. */
const SIMULATED_ACTIONS = 2_000;
/** Number of first attempts that are labelled. */
const NUMBERED_ACTIONS = 10;
/** Maximum number of map cells in each direction. */
const MAX_MAP_CELLS = 24;

type Scored = Schema<"ScoredAction">;

/** Input of the maps. */
export interface ActionMapsInput {
  family: Schema<"FamilyOut">;
  policies: readonly Schema<"PolicyOut">[];
  /** Simulated worlds of the family. */
  worlds: readonly Schema<"WorldOut">[];
  policy: string | null;
  /** Initial task; `null` for the first. */
  task: string | null;
}

export interface ActionMaps {
  element: HTMLElement;
  task: () => string;
}

/** The maps of a family's tasks. */
export function actionMaps(of: ActionMapsInput, context: Context): ActionMaps {
  const ids = Array.from({ length: of.family.tasks }, (_, i) => `${of.family.name}:${String(i).padStart(3, "0")}`);
  const policyIds = of.policies.filter((p) => p.task === of.family.name).map((p) => p.id);
  const policy = choice("Policy", "policy", [...policyIds, CHANCE].map((id) => [id, id] as const));
  const task = choice("Task", "task", ids.map((id) => [id, id] as const));
  const world = choice("Solutions simulated in", "world", of.worlds.map((w) => [w.id, w.id] as const));
  const target = choice("Object placed", "target", []);
  policy.input.value = of.policy && policyIds.includes(of.policy) ? of.policy : (policyIds.at(-1) ?? CHANCE);
  if (of.task) task.input.value = of.task;
  const container = h("div", { class: "stack map-place" });
  const state = h("p", { class: "soft", role: "status" });
  const simulated = of.worlds.find((w) => w.id === `${of.family.name}-sim`);
  if (simulated) world.input.value = simulated.id;
  let scene: Scene | null = null;
  const show = latest<boolean>(async (newTask) => {
    try {
      put(state, "Ranking and simulating…");
      const id = task.input.value;
      if (newTask || !scene) {
        scene = (await loadTask(id, context.signal)).scene;
        const axes = placementAxes(scene);
        put(target.input, ...axes.map((a) => h("option", { value: a.target }, a.target)));
        target.element.hidden = axes.length < 2;
      }
      const data = await loadMapData(policy.input.value, id, world.input.value, context.signal);
      const axes = placementAxes(scene).find((a) => a.target === target.input.value);
      if (!axes) throw new Error(`${id} has no object with a free position`);
      put(container, ...mapElements(scene, id, actionGrid(axes, [...data.ranked, ...data.sampled].map((one) => one.action), MAX_MAP_CELLS), policy.input.value, world.input.value, data));
      put(state);
    } catch (e) {
      put(state);
      context.fail(e);
    }
  });
  for (const one of [policy, world, target]) one.input.addEventListener("change", () => show(false));
  task.input.addEventListener("change", () => show(true));
  // Ranking the whole action space is expensive: only when visible.
  const visibility = new IntersectionObserver((entries) => {
    if (!entries.some((e) => e.isIntersecting)) return;
    visibility.disconnect();
    show(true);
  });
  visibility.observe(container);
  context.signal.addEventListener("abort", () => visibility.disconnect());
  const element = h("div", { class: "stack" }, h("div", { class: "four" }, policy.element, task.element, world.element, target.element), state, container);
  return { element, task: () => task.input.value };
}

interface MapData {
  ranked: Scored[];
  /** Whether each of the first attempts solves the task in the simulation. */
  firstSolve: boolean[];
  /** A random sample of the action space. */
  sampled: Scored[];
  solved: boolean[];
}

async function loadMapData(policy: string, task: string, world: string, signal: AbortSignal): Promise<MapData> {
  const act = async (id: string, count: number): Promise<Scored[]> => {
    const body = { task, count };
    return (await ok(api.POST("/v1/policies/{id}/act", { params: { path: { id } }, body, signal }))).actions;
  };
  const [ranked, sampled] = await Promise.all([act(policy, MAX_RANKED_ACTIONS), act(CHANCE, SIMULATED_ACTIONS)]);
  const first = ranked.slice(0, NUMBERED_ACTIONS);
  const body = { task, actions: [...first, ...sampled].map((one) => one.index) };
  const { results } = await ok(api.POST("/v1/worlds/{id}/rollout", { params: { path: { id: world } }, body, signal }));
  const solved = results.map((r) => r.solved === true);
  return { ranked, firstSolve: solved.slice(0, first.length), sampled: sampled, solved: solved.slice(first.length) };
}

/** Both maps, the list of first attempts, and the selected cell. */
function mapElements(scene: Scene, task: string, grid: ActionGrid, policy: string, world: string, data: MapData): HTMLElement[] {
  const components = scene.action!.components;
  const actions = data.ranked.map((one) => one.action);
  const best = bestByCell(grid, actions);
  const solvedCells = solvedByCell(grid, data.sampled.map((one) => one.action), data.solved);
  const policyMap = picture(scene, `First attempts of ${policy} on ${task}; stronger colours are tried earlier. Arrow keys select a cell, Enter plays it.`);
  const solutionMap = picture(scene, `Solutions of ${task} in ${world}; stronger colours have a larger share of solving actions.`);
  shadeCells(policyMap, grid, components, new Map([...best].map(([at, i]) => [at, strength(i + 1, actions.length)])), "wanted-cell");
  shadeCells(solutionMap, grid, components, new Map([...solvedCells].map(([at, c]) => [at, c.of ? c.solve / c.of : 0])), "true-cell");
  numberActions(policyMap, scene, grid, actions.slice(0, NUMBERED_ACTIONS), data.firstSolve);
  const chosenText = h("p", { class: "chosen", role: "status" });
  const chosen = cellChooser([policyMap, solutionMap], grid, components, (at) => {
    const rank = best.get(at);
    const cellCounts = solvedCells.get(at);
    const action = rank === undefined ? (cellCounts?.one ?? null) === null ? null : data.sampled[cellCounts!.one!]!.action : actions[rank]!;
    put(chosenText, ...cellText(scene, task, action, rank, cellCounts));
    return action === null ? null : play(task, action);
  });
  const firstAction = actions[0];
  if (firstAction) chosen(cellOf(grid, firstAction));
  const share = data.solved.filter(Boolean).length / Math.max(1, data.solved.length);
  const right = data.firstSolve.filter(Boolean).length;
  const ranks = h("p", { class: "soft" }, `The best ${actions.length} actions of ${policy}; cells without any are blank. Green rings: solved in ${world}.`);
  const trials = h("p", { class: "soft" }, `${Math.round(100 * share)} % of ${data.solved.length} random actions solve the task.`);
  const list = actions.slice(0, NUMBERED_ACTIONS).map((action, i) => actionItem(scene, task, action, data.firstSolve[i] ?? false));
  return [
    chosenText,
    h("div", { class: "sides" }, figure(`Attempts of ${policy}`, policyMap, ranks), figure(`Solutions in ${world}`, solutionMap, trials)),
    h("details", { open: true }, h("summary", {}, `First attempts: ${right} of ${data.firstSolve.length} solve the task in ${world}`), h("ol", { class: "tries" }, ...list)),
  ];
}

function figure(title: string, map: Picture, note: HTMLElement): HTMLElement {
  return h("figure", { class: "map" }, h("figcaption", {}, h("strong", {}, title)), map.svg, note);
}

/** Fills cells with a strength. */
function shadeCells(at: Picture, grid: ActionGrid, components: readonly Component[], cells: ReadonlyMap<number, number>, look: string): void {
  const rects = [...cells].map(([number, how]) => {
    const [x, y, width, height] = cellBox(grid, components, number);
    return how > 0 ? s("rect", { class: look, x, y, width, height, "fill-opacity": (0.12 + 0.78 * how).toFixed(3) }) : null;
  });
  at.under.append(s("g", { "data-cells": rects.filter(Boolean).length }, ...rects));
}

/** The first attempts, each at its position with its number; nearby attempts share a label. */
function numberActions(at: Picture, scene: Scene, grid: ActionGrid, first: readonly (readonly number[])[], solve: readonly boolean[]): void {
  const components = scene.action!.components;
  const size = (at.box[2] - at.box[0]) * 0.032;
  const points = first.map((a): Point => [valueAt(components[grid.axes.x]!, a[grid.axes.x]!), valueAt(components[grid.axes.y]!, a[grid.axes.y]!)]);
  const circles = first.map((action, i) => {
    const object = applyAction(scene, action).bodies.find((b) => b.name === grid.axes.target);
    const r = object?.shape.type === "disc" ? object.shape.radius : size / 2;
    return s("circle", { class: `try${solve[i] ? " solves" : ""}`, cx: points[i]![0], cy: points[i]![1], r, "vector-effect": "non-scaling-stroke" });
  });
  const labels = groupNearby(points, size * 1.1).map((group) => {
    const [x, y] = points[group[0]!]!;
    // Next to the object, on the side with more space.
    const right = x < at.box[0] + 0.7 * (at.box[2] - at.box[0]);
    const side = (right ? 1 : -1) * (Number(circles[group[0]!]!.getAttribute("r")) + size * 0.3);
    return s("text", { class: "try-number", transform: `translate(${x + side} ${y}) scale(1 -1)`, "font-size": size, "text-anchor": right ? "start" : "end", dy: "0.35em" }, ranges(group.map((i) => i + 1)));
  });
  at.over.append(...[...circles].reverse(), ...labels);
}

/** Selection of a cell by mouse, or by arrow keys on the first picture; `onSelect` returns the link that Enter follows. */
function cellChooser(at: readonly Picture[], grid: ActionGrid, components: readonly Component[], told: (cell: number) => string | null): (cell: number) => void {
  const frames = at.map((p) => {
    const frame = s("rect", { class: "chosen-cell", "vector-effect": "non-scaling-stroke" });
    p.over.append(frame);
    return frame;
  });
  let [now, leads]: [number, string | null] = [0, null];
  const choose = (number: number): void => {
    now = number;
    const [x, y, width, height] = cellBox(grid, components, number);
    for (const frame of frames) set(frame, { x, y, width, height });
    leads = told(number);
  };
  for (const p of at) {
    p.svg.addEventListener("click", (event) => {
      const [x, y] = p.at(event);
      const [cx, cy] = [components[grid.axes.x]!, components[grid.axes.y]!];
      const [u, v] = [(x - cx.low) / (cx.high - cx.low), (y - cy.low) / (cy.high - cy.low)];
      if (u < grid.columns[0]! || u > grid.columns.at(-1)! || v < grid.rows[0]! || v > grid.rows.at(-1)!) return;
      const action: number[] = [];
      [action[grid.axes.x], action[grid.axes.y]] = [u, v];
      choose(cellOf(grid, action));
    });
  }
  const moves: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  set(at[0]!.svg, { tabindex: 0, role: "application" });
  at[0]!.svg.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && leads) location.hash = leads;
    const move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    const [column, row] = [(now % columnCount(grid)) + move[0], Math.floor(now / columnCount(grid)) + move[1]];
    if (column >= 0 && row >= 0 && column < columnCount(grid) && row < grid.rows.length - 1) choose(row * columnCount(grid) + column);
  });
  return choose;
}

/** Text about a cell. */
function cellText(scene: Scene, task: string, action: readonly number[] | null, rank: number | undefined, cellCounts: { of: number; solve: number } | undefined): (HTMLElement | string)[] {
  const sampled = cellCounts ? `${cellCounts.solve} of ${cellCounts.of} random actions here solve the task` : "no random action fell here";
  if (!action) return [`This cell: ${sampled}; none of the policy's best actions is here.`];
  const which = rank === undefined ? "a solving action" : `attempt ${rank + 1}`;
  return [`This cell: ${which} (${words(scene, action)}); ${sampled}. `, h("a", { href: play(task, action) }, "Play it")];
}

function actionItem(scene: Scene, task: string, action: readonly number[], solves: boolean): HTMLElement {
  const verdict = h("span", { class: `state ${solves ? "succeeded" : ""}` }, solves ? "solves" : "misses");
  const id = uniqueId("try");
  return h("li", {}, h("div", { class: "row" }, h("span", { id }, words(scene, action)), verdict, h("a", { href: play(task, action), "aria-describedby": id }, "Play it")));
}

/** An action in SI: `red at (24.70, 17.79) m, radius 2.91 m`. */
function words(scene: Scene, action: readonly number[]): string {
  const components = scene.action!.components;
  const chosenText = (i: number): string => valueAt(components[i]!, action[i]!).toFixed(2);
  const of = (target: string): string => {
    const axes = placementAxes(scene).find((a) => a.target === target);
    const rest = components.flatMap((c, i) => (c.target !== target || i === axes?.x || i === axes?.y ? [] : [`${c.set} ${chosenText(i)} ${unit(c)}`]));
    return [axes ? `${target} at (${chosenText(axes.x)}, ${chosenText(axes.y)}) m` : target, ...rest].join(", ");
  };
  return targets(scene).map(of).join("; ");
}

function play(task: string, action: readonly number[]): string {
  return link("play", [task], { action: action.map((v) => Number(v.toFixed(6))).join(",") });
}
