// Diagnose: measured tracks in, missing effects out. `#/diagnose` is the setup, `#/diagnose/job-3` a diagnosis in progress or
// ended.

import { h, put } from "../dom";
import type { View } from "../view";
import { setupView } from "./diagnose/setupView";
import { progressView } from "./diagnose/progressView";
import "./diagnose.css";

export const diagnose: View = {
  id: "diagnose",
  title: "Diagnose",
  about: "Upload tracked positions to find missing physics.",
  open: (place, context) => {
    // The container scopes the view's styles.
    const container = h("div", { class: "diagnose" });
    put(place, container);
    return context.rest[0] ? progressView(container, context.rest[0], context) : setupView(container, context);
  },
};
