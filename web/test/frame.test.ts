import assert from "node:assert/strict";
import { test } from "node:test";
import { parseEvent as event, events } from "../src/api/events";
import { describeError, ProblemError } from "../src/api/problem";
import { link, parseAddress } from "../src/view";

test("addresses are parsed and formatted losslessly", () => {
  assert.equal(link("jobs", ["job 3"], { state: "failed" }), "#/jobs/job%203?state=failed");
  const read = parseAddress("#/jobs/job%203?state=failed");
  assert.deepEqual([read.view, read.rest, read.query.get("state")], ["jobs", ["job 3"], "failed"]);
  for (const hash of ["", "#", "#/", "#//"]) assert.equal(parseAddress(hash).view, "");
  assert.deepEqual(parseAddress("#/a/%").rest, ["%"]);
});

test("problems are described with their field", () => {
  const problem = { type: "https://iplw.dev/problems/capacity", title: "No room", status: 429, detail: "8 jobs wait" };
  const { title, detail, field } = describeError(new ProblemError({ ...problem, field: "task" }, 3));
  assert.equal(detail, "8 jobs wait. Try again in 3 s.");
  assert.equal(field, "task");
  assert.equal(title, "Budget spent or limit reached");
});

test("blocks of a stream are parsed as events, comments are ignored", () => {
  assert.deepEqual(event("id: 4\nevent: done\ndata: {\ndata: }"), { id: "4", event: "done", data: "{\n}" });
  assert.equal(event(": still here"), null);
});

test("events split at any byte are reassembled", async () => {
  const bytes = new TextEncoder().encode("id: 1\ndata: ä\n\n: x\n\nid: 2\ndata: b\n\n");
  for (let size = 1; size < bytes.length; size++) {
    const body = new ReadableStream<Uint8Array>({
      start(controller) {
        for (let i = 0; i < bytes.length; i += size) controller.enqueue(bytes.slice(i, i + size));
        controller.close();
      },
    });
    const received: string[] = [];
    for await (const { data } of events(body)) received.push(data);
    assert.deepEqual(received, ["ä", "b"], `chunks of ${size}`);
  }
});
