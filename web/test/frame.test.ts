import assert from "node:assert/strict";
import { test } from "node:test";
import { parseEvent as event, events } from "../src/api/events";
import { describeError, ProblemError } from "../src/api/problem";
import { link, parseAddress } from "../src/view";

test("addresses go there and back", () => {
  assert.equal(link("jobs", ["job 3"], { state: "failed" }), "#/jobs/job%203?state=failed");
  const read = parseAddress("#/jobs/job%203?state=failed");
  assert.deepEqual([read.view, read.rest, read.query.get("state")], ["jobs", ["job 3"], "failed"]);
  for (const hash of ["", "#", "#/", "#//"]) assert.equal(parseAddress(hash).view, "");
  assert.deepEqual(parseAddress("#/a/%").rest, ["%"]);
});

test("problems are told with their field", () => {
  const problem = { type: "https://iplw.dev/problems/capacity", title: "No room", status: 429, detail: "8 jobs wait" };
  const { title, detail, field } = describeError(new ProblemError({ ...problem, field: "task" }, 3));
  assert.equal(detail, "8 jobs wait. Try again in 3 s.");
  assert.equal(field, "task");
  assert.match(title, /too much/);
});

test("blocks of a stream are events, comments are not", () => {
  assert.deepEqual(event("id: 4\nevent: done\ndata: {\ndata: }"), { id: "4", event: "done", data: "{\n}" });
  assert.equal(event(": still here"), null);
});

test("events cut anywhere are put together", async () => {
  const bytes = new TextEncoder().encode("id: 1\ndata: ä\n\n: x\n\nid: 2\ndata: b\n\n");
  for (let size = 1; size < bytes.length; size++) {
    const body = new ReadableStream<Uint8Array>({
      start(controller) {
        for (let i = 0; i < bytes.length; i += size) controller.enqueue(bytes.slice(i, i + size));
        controller.close();
      },
    });
    const found: string[] = [];
    for await (const { data } of events(body)) found.push(data);
    assert.deepEqual(found, ["ä", "b"], `pieces of ${size}`);
  }
});
