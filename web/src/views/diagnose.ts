// Diagnose: measured tracks in, the name of what the simulation gets wrong out. `#/diagnose` is the desk, `#/diagnose/job-3` a
// diagnosis that runs or ran.

import { h, put } from "../dom";
import type { View } from "../view";
import { setupView } from "./diagnose/setupView";
import { progressView } from "./diagnose/progressView";
import "./diagnose.css";

export const diagnose: View = {
  id: "diagnose",
  title: "Diagnose",
  about: "Drop the tracks of a film, and read what the simulation gets wrong.",
  open: (place, context) => {
    // Its looks are its own.
    const container = h("div", { class: "diagnose" });
    put(place, container);
    return context.rest[0] ? progressView(container, context.rest[0], context) : setupView(container, context);
  },
};
