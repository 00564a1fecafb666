// The action space as a map: where one thing is placed, whatever the other numbers of an action are.

import { valueAt } from "../../scene/action";
import type { Component, Scene } from "../../scene/types";

/** A thing whose place an action sets. */
export interface PlacementAxes {
  target: string;
  /** Numbers of the components that set its place. */
  x: number;
  y: number;
}

/** Things whose place, both ways, an action sets. */
export function placementAxes(scene: Scene): PlacementAxes[] {
  const components = scene.action?.components ?? [];
  const of = (target: string, set: string): number => components.findIndex((c) => c.target === target && c.set === set);
  const names = [...new Set(components.map((c) => c.target))];
  return names.map((target) => ({ target, x: of(target, "x"), y: of(target, "y") })).filter((a) => a.x >= 0 && a.y >= 0);
}

/** A grid over where one thing is put: edges of its columns and rows, rising, as shares of the range. */
export interface ActionGrid {
  axes: PlacementAxes;
  columns: readonly number[];
  rows: readonly number[];
}

/** A grid of at most `most` cells each way. Where actions are but at a few places, each has a cell of its own. */
export function actionGrid(axes: PlacementAxes, actions: readonly (readonly number[])[], maxCells: number): ActionGrid {
  return { axes, columns: edges(actions.map((a) => a[axes.x]!), maxCells), rows: edges(actions.map((a) => a[axes.y]!), maxCells) };
}

function edges(solvedByCell: readonly number[], maxCells: number): number[] {
  const places = [...new Set(solvedByCell)].sort((a, b) => a - b);
  if (places.length > maxCells || places.length < 2) return Array.from({ length: maxCells + 1 }, (_, i) => i / maxCells);
  const inner = places.slice(1).map((v, i) => (v + places[i]!) / 2);
  return [2 * places[0]! - inner[0]!, ...inner, 2 * places.at(-1)! - inner.at(-1)!];
}

/** Number of the cell of an action, row by row from below; the nearest of one beyond the grid. */
export function cellOf(grid: ActionGrid, action: readonly number[]): number {
  const of = (share: number, edges: readonly number[]): number => {
    const past = edges.findIndex((edge) => edge > share);
    return past < 0 ? edges.length - 2 : Math.max(0, past - 1);
  };
  return of(action[grid.axes.y]!, grid.rows) * columnCount(grid) + of(action[grid.axes.x]!, grid.columns);
}

/** Cells of a row. */
export function columnCount(grid: ActionGrid): number {
  return grid.columns.length - 1;
}

/** Left, bottom, width, height of a cell, m. */
export function cellBox(grid: ActionGrid, components: readonly Component[], number: number): [number, number, number, number] {
  const [cx, cy] = [components[grid.axes.x]!, components[grid.axes.y]!];
  const [column, row] = [number % columnCount(grid), Math.floor(number / columnCount(grid))];
  const [left, bottom] = [valueAt(cx, grid.columns[column]!), valueAt(cy, grid.rows[row]!)];
  return [left, bottom, valueAt(cx, grid.columns[column + 1]!) - left, valueAt(cy, grid.rows[row + 1]!) - bottom];
}

/** For each cell that any action is in, the number of the first action there: of a list from best to worst, its best. */
export function bestByCell(grid: ActionGrid, actions: readonly (readonly number[])[]): Map<number, number> {
  const byCell = new Map<number, number>();
  actions.forEach((action, i) => {
    const at = cellOf(grid, action);
    if (!byCell.has(at)) byCell.set(at, i);
  });
  return byCell;
}

/** For each cell that any action is in, how many solve, of how many, and one that does. */
export function shares(grid: ActionGrid, actions: readonly (readonly number[])[], solved: readonly boolean[]): Map<number, { of: number; solve: number; one: number | null }> {
  const byCell = new Map<number, { of: number; solve: number; one: number | null }>();
  actions.forEach((action, i) => {
    const at = cellOf(grid, action);
    const counts = byCell.get(at) ?? { of: 0, solve: 0, one: null };
    counts.of += 1;
    if (solved[i]) [counts.solve, counts.one] = [counts.solve + 1, counts.one ?? i];
    byCell.set(at, counts);
  });
  return byCell;
}

/** How strongly the place of the `rank`-th of `of` tries is shown, 0 to 1: the first fully, and by the logarithm from there, as
 * AUCCESS weighs attempts. */
export function strength(rank: number, of: number): number {
  return of <= 1 ? 1 : 1 - Math.log(rank) / Math.log(of + 1);
}

/** Numbers that stand at about the same place are said together: `[[0, 2], [1]]`. */
export function groupNearby(points: readonly (readonly [number, number])[], near: number): number[][] {
  const groups: number[][] = [];
  points.forEach(([x, y], i) => {
    const group = groups.find((g) => Math.hypot(points[g[0]!]![0] - x, points[g[0]!]![1] - y) < near);
    if (group) group.push(i);
    else groups.push([i]);
  });
  return groups;
}

/** Rising numbers in short: `1–4, 7`. */
export function ranges(numbers: readonly number[]): string {
  const runs: [number, number][] = [];
  for (const n of numbers) {
    const last = runs.at(-1);
    if (last && last[1] === n - 1) last[1] = n;
    else runs.push([n, n]);
  }
  return runs.map(([a, b]) => (a === b ? `${a}` : b === a + 1 ? `${a}, ${b}` : `${a}–${b}`)).join(", ");
}
