import { api, ok } from "../api/client";
import { h, put } from "../dom";
import type { View } from "../view";

export const jobs: View = {
  id: "jobs",
  title: "Jobs",
  about: "Everything that runs, waits, has ended or failed.",
  async open(place, { signal }) {
    const { jobs } = await ok(api.GET("/v1/jobs", { params: { query: { limit: 100 } }, signal }));
    put(place, h("p", {}, `${jobs.length} jobs`));
  },
};
