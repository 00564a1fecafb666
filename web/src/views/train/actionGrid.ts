// The action space as a grid over the position of one object, whatever the other components.

import { valueAt } from "../../scene/action";
import type { Component, Scene } from "../../scene/types";

/** An object whose position the action sets. */
export interface PlacementAxes {
  target: string;
  /** Indices of the components that set its position. */
  x: number;
  y: number;
}

/** Objects of which the action sets both coordinates. */
export function placementAxes(scene: Scene): PlacementAxes[] {
  const components = scene.action?.components ?? [];
  const of = (target: string, set: string): number => components.findIndex((c) => c.target === target && c.set === set);
  const names = [...new Set(components.map((c) => c.target))];
  return names.map((target) => ({ target, x: of(target, "x"), y: of(target, "y") })).filter((a) => a.x >= 0 && a.y >= 0);
}

/** A grid over the positions of one object: edges of columns and rows, ascending, as shares of the range. */
export interface ActionGrid {
  axes: PlacementAxes;
  columns: readonly number[];
  rows: readonly number[];
}

/** A grid of at most `maxCells` cells in each direction. If actions have few distinct positions, each has its own cell. */
export function actionGrid(axes: PlacementAxes, actions: readonly (readonly number[])[], maxCells: number): ActionGrid {
  return { axes, columns: edges(actions.map((a) => a[axes.x]!), maxCells), rows: edges(actions.map((a) => a[axes.y]!), maxCells) };
}

function edges(shares: readonly number[], maxCells: number): number[] {
  const places = [...new Set(shares)].sort((a, b) => a - b);
  if (places.length > maxCells || places.length < 2) return Array.from({ length: maxCells + 1 }, (_, i) => i / maxCells);
  const inner = places.slice(1).map((v, i) => (v + places[i]!) / 2);
  return [2 * places[0]! - inner[0]!, ...inner, 2 * places.at(-1)! - inner.at(-1)!];
}

/** Index of the cell of an action, row by row from the bottom; actions outside the grid get the nearest cell. */
export function cellOf(grid: ActionGrid, action: readonly number[]): number {
  const of = (share: number, edges: readonly number[]): number => {
    const past = edges.findIndex((edge) => edge > share);
    return past < 0 ? edges.length - 2 : Math.max(0, past - 1);
  };
  return of(action[grid.axes.y]!, grid.rows) * columnCount(grid) + of(action[grid.axes.x]!, grid.columns);
}

/** Number of columns. */
export function columnCount(grid: ActionGrid): number {
  return grid.columns.length - 1;
}

/** Left, bottom, width and height of a cell, m. */
export function cellBox(grid: ActionGrid, components: readonly Component[], number: number): [number, number, number, number] {
  const [cx, cy] = [components[grid.axes.x]!, components[grid.axes.y]!];
  const [column, row] = [number % columnCount(grid), Math.floor(number / columnCount(grid))];
  const [left, bottom] = [valueAt(cx, grid.columns[column]!), valueAt(cy, grid.rows[row]!)];
  return [left, bottom, valueAt(cx, grid.columns[column + 1]!) - left, valueAt(cy, grid.rows[row + 1]!) - bottom];
}

/** Index of the first action in each non-empty cell: the best one, if actions are sorted from best to worst. */
export function bestByCell(grid: ActionGrid, actions: readonly (readonly number[])[]): Map<number, number> {
  const byCell = new Map<number, number>();
  actions.forEach((action, i) => {
    const at = cellOf(grid, action);
    if (!byCell.has(at)) byCell.set(at, i);
  });
  return byCell;
}

/** For each non-empty cell the number of actions, the number that solve, and one that does. */
export function solvedByCell(grid: ActionGrid, actions: readonly (readonly number[])[], solved: readonly boolean[]): Map<number, { of: number; solve: number; one: number | null }> {
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

/** Colour strength of rank `rank` of `of`, 0 to 1: 1 for the first, decreasing with the logarithm of the rank, like the weights of
 * AUCCESS. */
export function strength(rank: number, of: number): number {
  return of <= 1 ? 1 : 1 - Math.log(rank) / Math.log(of + 1);
}

/** Groups of indices whose points nearly coincide: `[[0, 2], [1]]`. */
export function groupNearby(points: readonly (readonly [number, number])[], near: number): number[][] {
  const groups: number[][] = [];
  points.forEach(([x, y], i) => {
    const group = groups.find((g) => Math.hypot(points[g[0]!]![0] - x, points[g[0]!]![1] - y) < near);
    if (group) group.push(i);
    else groups.push([i]);
  });
  return groups;
}

/** Ascending numbers as ranges: `1–4, 7`. */
export function ranges(numbers: readonly number[]): string {
  const runs: [number, number][] = [];
  for (const n of numbers) {
    const last = runs.at(-1);
    if (last && last[1] === n - 1) last[1] = n;
    else runs.push([n, n]);
  }
  return runs.map(([a, b]) => (a === b ? `${a}` : b === a + 1 ? `${a}, ${b}` : `${a}–${b}`)).join(", ");
}
