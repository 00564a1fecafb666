// Diagnose: measured tracks in, the name of what the simulation gets wrong out. `#/diagnose` is the desk, `#/diagnose/job-3` a
// diagnosis that runs or ran.

import { h, put } from "../dom";
import type { View } from "../view";
import { desk } from "./diagnose/desk";
import { running } from "./diagnose/running";
import "./diagnose.css";

export const diagnose: View = {
  id: "diagnose",
  title: "Diagnose",
  about: "Drop the tracks of a film, and read what the simulation gets wrong.",
  open: (place, context) => {
    // Its looks are its own.
    const own = h("div", { class: "diagnose" });
    put(place, own);
    return context.rest[0] ? running(own, context.rest[0], context) : desk(own, context);
  },
};
