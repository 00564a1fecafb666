// Live worlds. `#/live` is the list, `#/live/w1` one world with its events.

import { worldList } from "./live/worldList";
import { worldView } from "./live/worldView";
import type { View } from "../view";
import "./live.css";

export const live: View = {
  id: "live",
  title: "Live worlds",
  about: "All worlds on the server, with live events of each. Watching is free.",
  open: (place, context) => (context.rest[0] ? worldView(place, context.rest[0], context) : worldList(place, context)),
};
