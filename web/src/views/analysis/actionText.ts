// Actions in words.

import { short } from "../../parts/slider";
import { unit, valueAt } from "../../scene/action";
import type { Scene } from "../../scene/types";

/** The values of an action: "red: x 20.6 m, y 1.9 m, radius 1.0 m". */
export function actionText(scene: Scene, action: readonly number[]): string {
  const values = new Map<string, string[]>();
  (scene.action?.components ?? []).forEach((component, i) => {
    const list = values.get(component.target) ?? [];
    list.push(`${component.set} ${short(valueAt(component, action[i] ?? 0), unit(component))}`);
    values.set(component.target, list);
  });
  return [...values].map(([name, list]) => `${name}: ${list.join(", ")}`).join("; ");
}

/** A probability as a percentage. */
export function percent(share: number): string {
  return `${Math.round(100 * share)} %`;
}

/** A list in a sentence: "a, b and c". */
export function enumeration(words: readonly string[]): string {
  return words.length < 2 ? (words[0] ?? "") : `${words.slice(0, -1).join(", ")} and ${words.at(-1)}`;
}

/** A sentence with a capital. */
export function capital(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
