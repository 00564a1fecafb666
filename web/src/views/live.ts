// Live worlds: who acts where. `#/live` is the list, `#/live/w1` one world as it is acted in.

import { worldList } from "./live/worldList";
import { worldView } from "./live/worldView";
import type { View } from "../view";
import "./live.css";

export const live: View = {
  id: "live",
  title: "Live worlds",
  about: "Every world of the server, and what programs do in one of them as they do it. To look on spends nothing.",
  open: (place, context) => (context.rest[0] ? worldView(place, context.rest[0], context) : worldList(place, context)),
};
