// Colours of bodies: a colour word in the name, else a palette that is safe for colour blindness (Okabe and Ito 2008).

import type { Scene } from "./types";

const PALETTE = ["#e69f00", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#b8a800"];
const WORDS: Record<string, string> = {
  red: "#d62f2f",
  green: "#2fa04a",
  blue: "#2b6cd4",
  orange: "#f08a1d",
  yellow: "#e8c71a",
  purple: "#8a4fbf",
  violet: "#8a4fbf",
  pink: "#e774a8",
  magenta: "#c2339b",
  cyan: "#22aebf",
  brown: "#8b5a2b",
  black: "#2a2a2a",
  white: "#fafafa",
  grey: "#8c8c8c",
  gray: "#8c8c8c",
};

/** Name -> colour of each body. */
export function colours(scene: Scene): Map<string, string> {
  let paletteIndex = 0;
  return new Map(
    scene.bodies.map((body) => {
      const word = body.name.toLowerCase().split(/[^a-z]+/).find((w) => w in WORDS);
      return [body.name, word ? WORDS[word]! : PALETTE[paletteIndex++ % PALETTE.length]!];
    }),
  );
}
