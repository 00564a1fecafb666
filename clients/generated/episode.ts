// A whole episode through a client that openapi-typescript made; every line is checked against the document.
// Prints one JSON line: what `test_generated.py` compares with the other clients.

import createClient from "openapi-fetch";
import type { components, paths } from "./out/schema.js";

type Problem = components["schemas"]["Problem"];

const client = createClient<paths>({ baseUrl: process.argv[2] ?? "http://127.0.0.1:8080" });

function must<T>(answer: { data?: T; error?: unknown; response: Response }): T {
  if (answer.data === undefined) {
    throw new Error(`${answer.response.status}: ${JSON.stringify(answer.error)}`);
  }
  return answer.data;
}

const families = must(await client.GET("/v1/tasks")).families.map((family) => family.name);
const world = must(
  await client.POST("/v1/worlds", { body: { task: "bowling:002", latents: { friction: 0.5 } } }),
);
const params = { path: { id: world.id } };
const start = must(await client.POST("/v1/worlds/{id}/reset", { params, body: { seed: 1 } }));
const tried = must(
  await client.POST("/v1/worlds/{id}/rollout", {
    params,
    body: { actions: [...Array(32).keys()].map((k) => k * 1000) },
  }),
);
const chosen = tried.results.findIndex((result) => result.valid);
const step = must(
  await client.POST("/v1/worlds/{id}/step", { params, body: { action: chosen * 1000 } }),
);
const refused = await client.POST("/v1/worlds/{id}/step", { params, body: { action: [0.5, 0.5, 0.2] } });
const problem = refused.error as Problem | undefined;
await client.DELETE("/v1/worlds/{id}", { params });
const gone = await client.GET("/v1/worlds/{id}", { params });

console.log(
  JSON.stringify({
    families,
    task: start.info.task,
    first: start.observation,
    chosen,
    observation: step.observation,
    reward: step.reward,
    terminated: step.terminated,
    steps: step.info.steps,
    refused: problem?.status,
    gone: gone.response.status,
  }),
);
