// The world of a scene that another view stored, for a plan, which needs a task of a family.

import { h } from "../../dom";
import { storedScene } from "../../scene/handoff";
import { allObjects, type Scene } from "../../scene/types";
import { type Context, link } from "../../view";
import { type Physics, physicsFrom, physicsText } from "../analysis/physics";

export interface SceneWorld {
  /** The family that the scene is a task of, if any. */
  family: string | null;
  /** Its effects and, of a task's scene, its latents; `null` if it has neither. */
  physics: Physics | null;
  notice: HTMLElement;
}

/** The world of the stored scene, if the address asks for it. */
export function sceneWorld(families: readonly { name: string }[], context: Context): SceneWorld | null {
  if (context.rest[0] !== "scene") return null;
  const scene = storedScene();
  if (!scene) return { family: null, physics: null, notice: notice("No scene is stored. Open one from Diagnose, Calibrate or Make.", false) };
  const name = scene.name ? `“${scene.name}”` : "the scene";
  // Scenes of tasks bear the name of their family: "bowling, calibrated".
  const family = families.find((f) => f.name === scene.name?.split(",")[0]?.trim())?.name ?? null;
  const physics: Physics = { latents: family ? latentsOf(scene) : {}, effects: (scene.effects as Physics["effects"] | undefined) ?? [] };
  const hasPhysics = physics.effects.length + Object.keys(physics.latents).length > 0;
  const needs = "A plan needs a task of a family: a goal, and actions to choose from.";
  const text = family
    ? `The tasks of ${family} are planned in the world of ${name}: ${physicsText(physics)}.`
    : hasPhysics
      ? `${needs} Choose one below; it is simulated with the effects of ${name}: ${physicsText(physics)}.`
      : `${needs} ${name} has no effects to add to one: try its actions in Play, or choose a task below.`;
  return { family, physics: hasPhysics ? physics : null, notice: notice(text, true) };
}

/** The latents of the first object that carries them. */
function latentsOf(scene: Scene): Physics["latents"] {
  const carrier = allObjects(scene).find((object) => !scene.carriers || scene.carriers.includes(object.name));
  return physicsFrom((["density", "friction", "restitution"] as const).map((name) => [name, carrier?.[name] ?? null])).latents;
}

function notice(text: string, hasScene: boolean): HTMLElement {
  const play = h("p", {}, h("a", { href: link("play", ["scene"]) }, "Open the scene itself in Play"));
  return h("div", { class: "card notice", role: "note" }, h("p", {}, text.charAt(0).toUpperCase() + text.slice(1)), hasScene ? play : null);
}
