// The views, in the order of the navigation; the first is the default.

import { calibrate } from "./views/calibrate";
import { diagnose } from "./views/diagnose";
import { jobs } from "./views/jobs";
import { live } from "./views/live";
import { make } from "./views/make";
import { play } from "./views/play";
import { train } from "./views/train";
import type { View } from "./view";

export const VIEWS: readonly View[] = [play, make, calibrate, diagnose, train, live, jobs];
