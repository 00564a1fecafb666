// The views, in groups by purpose, in the order of the navigation; the first view is the default.

import { calibrate } from "./views/calibrate";
import { design } from "./views/design";
import { diagnose } from "./views/diagnose";
import { jobs } from "./views/jobs";
import { joints } from "./views/joints";
import { live } from "./views/live";
import { make } from "./views/make";
import { plan } from "./views/plan";
import { play } from "./views/play";
import { posterior } from "./views/posterior";
import { surface } from "./views/surface";
import { train } from "./views/train";
import type { ViewGroup } from "./view";

export const VIEW_GROUPS: readonly ViewGroup[] = [
  { title: "World", views: [play, make, joints] },
  { title: "Data", views: [calibrate, diagnose, posterior] },
  { title: "Decide", views: [plan, design, surface] },
  { title: "Learn", views: [train, live] },
  { title: "Server", views: [jobs] },
];
