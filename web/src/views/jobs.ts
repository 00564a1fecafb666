// Jobs, running or ended. `#/jobs` is the list, `#/jobs/job-3` one job, `#/jobs?compare=job-1,job-2` two beside each other.

import { duration } from "../parts/time";
import type { View } from "../view";
import { compareJobs } from "./jobs/compare";
import { jobList } from "./jobs/list";
import { jobPage } from "./jobs/page";
import "./jobs.css";

export const jobs: View = {
  id: "jobs",
  title: "Jobs",
  about: "Estimations, diagnoses, trainings and all other long computations, with their results. They survive a restart of the server.",
  open: (place, context) => {
    const compared = context.query.get("compare");
    if (compared) return compareJobs(place, compared.split(",").filter(Boolean), context);
    return context.rest[0] ? jobPage(place, context.rest[0], context) : jobList(place, context);
  },
};

export { duration };
