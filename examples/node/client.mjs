// A client of iplw in JavaScript, written from docs/reference/zeromq.md: a complete episode, a batch with arrays as frames, and an
// error. Exits with 1 at the first failed check.
//
//   node client.mjs tcp://127.0.0.1:5555

import assert from "node:assert/strict";
import { decode, encode } from "@msgpack/msgpack";
import { Dealer } from "zeromq";

const address = process.argv[2] ?? "tcp://127.0.0.1:5555";

/** An error response of the server: RFC 9457 problem details. */
class Problem extends Error {
  constructor(problem) {
    super(problem.detail);
    Object.assign(this, problem);
  }
}

const ARRAY_TYPES = {
  "<f4": Float32Array, "<f8": Float64Array, "<i4": Int32Array, "<i8": BigInt64Array,
  "<u4": Uint32Array, "<u8": BigUint64Array, "|u1": Uint8Array, "|b1": Uint8Array,
};

class Client {
  #socket = new Dealer({ linger: 0 });
  #next = 0;
  #pending = new Map();

  constructor(address) {
    this.#socket.connect(address);
    this.#read();
  }

  /** Calls an operation; `arrays` are {name: {dtype, shape, data}}. Rejects after `timeout` ms. */
  async call(op, args = {}, { arrays = {}, raw = false, timeout = 30_000 } = {}) {
    const id = ++this.#next;
    const descriptions = Object.entries(arrays).map(([name, { dtype, shape }]) => ({ name, dtype, shape }));
    const frames = Object.values(arrays).map(({ data }) => Buffer.from(data.buffer, data.byteOffset, data.byteLength));
    const response = new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this.#pending.delete(id);
        reject(new Error(`no response to ${op} within ${timeout} ms`));
      }, timeout);
      this.#pending.set(id, { resolve, reject, timer });
    });
    await this.#socket.send([encode({ v: 1, id, op, args, arrays: descriptions, raw }), ...frames]);
    return response;
  }

  close() {
    this.#socket.close();
  }

  async #read() {
    for await (const [head, ...frames] of this.#socket) {
      const { id, ok, result, arrays, problem } = decode(head);
      const call = this.#pending.get(id);
      if (!call) continue;
      this.#pending.delete(id);
      clearTimeout(call.timer);
      if (!ok) {
        call.reject(new Problem(problem));
        continue;
      }
      arrays.forEach(({ name, dtype, shape }, i) => {
        const bytes = Uint8Array.from(frames[i]);
        result[name] = { shape, data: new ARRAY_TYPES[dtype](bytes.buffer) };
      });
      call.resolve(result);
    }
  }
}

const client = new Client(address);
assert.deepEqual(await client.call("ping"), { pong: true });

// A single world, one action per request.
const world = await client.call("create_world", { task: "bowling", seed: 1 });
const start = await client.call("reset_world", { id: world.id, seed: 3 });
console.log(`${world.id} plays ${start.info.task}, observes ${world.observation_space.names.join(" ")}`);
let step;
for (let index = 0; !step?.terminated; index += 997) {
  step = await client.call("step_world", { id: world.id, action: index });
}
console.log(`valid action: solved ${step.info.solved} after ${step.info.steps} steps`);
assert.equal(step.observation.length, start.observation.length);

// Many worlds in one request, with arrays as frames in both directions.
const { worlds, world: first } = await client.call("create_worlds", { task: "basketball", count: 64 });
await client.call("reset_worlds", { worlds });
const { dimension } = first.action_space;
const data = Float32Array.from({ length: 64 * dimension }, (_, i) => ((i * 7919) % 1000) / 1000);
const batch = await client.call(
  "step_worlds",
  { worlds, autoreset: "same_step" },
  { arrays: { actions: { dtype: "<f4", shape: [64, dimension], data } }, raw: true },
);
assert.deepEqual(batch.observation.shape[0], 64);
assert.equal(batch.reward.data.length, 64);
console.log(`64 worlds: ${batch.valid.data.reduce((a, b) => a + b, 0)} valid, `
  + `${batch.solved.data.reduce((a, b) => a + b, 0)} solved`);
await client.call("delete_worlds", { worlds: [...worlds, world.id] });

// An error response has a status and a message.
const error = await client.call("step_world", { id: world.id, action: 0 }).catch((e) => e);
assert.ok(error instanceof Problem && error.status === 404, String(error));
console.log(`error: ${error.message}`);
client.close();
