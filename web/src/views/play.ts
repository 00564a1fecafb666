import { h } from "../dom";
import type { View } from "../view";

export const play: View = {
  id: "play",
  title: "Play",
  about: "Place something, let go, and see how far simulation and reality go together.",
  open(place) {
    place.append(h("p", {}, "…"));
  },
};
