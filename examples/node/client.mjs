// A client of iplw in a third language, from docs/reference/zeromq.md alone: a whole episode, a batch with arrays as frames, an
// error. Ends with 1 at the first surprise.
//
//   node client.mjs tcp://127.0.0.1:5555

import assert from "node:assert/strict";
import { decode, encode } from "@msgpack/msgpack";
import { Dealer } from "zeromq";

const address = process.argv[2] ?? "tcp://127.0.0.1:5555";

/** What the server refused: RFC 9457 problem details. */
class Problem extends Error {
  constructor(problem) {
    super(problem.detail);
    Object.assign(this, problem);
  }
}

const KINDS = {
  "<f4": Float32Array, "<f8": Float64Array, "<i4": Int32Array, "<i8": BigInt64Array,
  "<u4": Uint32Array, "<u8": BigUint64Array, "|u1": Uint8Array, "|b1": Uint8Array,
};

class Client {
  #socket = new Dealer({ linger: 0 });
  #next = 0;
  #waiting = new Map();

  constructor(address) {
    this.#socket.connect(address);
    this.#read();
  }

  /** Calls an operation; `arrays` are {name: {dtype, shape, data}}. Rejects after `timeout` ms. */
  async call(op, args = {}, { arrays = {}, raw = false, timeout = 30_000 } = {}) {
    const id = ++this.#next;
    const described = Object.entries(arrays).map(([name, { dtype, shape }]) => ({ name, dtype, shape }));
    const frames = Object.values(arrays).map(({ data }) => Buffer.from(data.buffer, data.byteOffset, data.byteLength));
    const answer = new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this.#waiting.delete(id);
        reject(new Error(`no answer to ${op} within ${timeout} ms`));
      }, timeout);
      this.#waiting.set(id, { resolve, reject, timer });
    });
    await this.#socket.send([encode({ v: 1, id, op, args, arrays: described, raw }), ...frames]);
    return answer;
  }

  close() {
    this.#socket.close();
  }

  async #read() {
    for await (const [head, ...frames] of this.#socket) {
      const { id, ok, result, arrays, problem } = decode(head);
      const asked = this.#waiting.get(id);
      if (!asked) continue;
      this.#waiting.delete(id);
      clearTimeout(asked.timer);
      if (!ok) {
        asked.reject(new Problem(problem));
        continue;
      }
      arrays.forEach(({ name, dtype, shape }, i) => {
        const bytes = Uint8Array.from(frames[i]);
        result[name] = { shape, data: new KINDS[dtype](bytes.buffer) };
      });
      asked.resolve(result);
    }
  }
}

const client = new Client(address);
assert.deepEqual(await client.call("ping"), { pong: true });

// One world, one action at a time.
const world = await client.call("create_world", { task: "bowling", seed: 1 });
const start = await client.call("reset_world", { id: world.id, seed: 3 });
console.log(`${world.id} plays ${start.info.task}, which shows ${world.observation_space.names.join(" ")}`);
let step;
for (let index = 0; !step?.terminated; index += 997) {
  step = await client.call("step_world", { id: world.id, action: index });
}
console.log(`an action was placed: solved ${step.info.solved} after ${step.info.steps} steps`);
assert.equal(step.observation.length, start.observation.length);

// Many worlds in one request, arrays as frames both ways.
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
console.log(`64 worlds: ${batch.valid.data.reduce((a, b) => a + b, 0)} placed, `
  + `${batch.solved.data.reduce((a, b) => a + b, 0)} solved`);
await client.call("delete_worlds", { worlds: [...worlds, world.id] });

// What is refused says where and why.
const refused = await client.call("step_world", { id: world.id, action: 0 }).catch((e) => e);
assert.ok(refused instanceof Problem && refused.status === 404, String(refused));
console.log(`refused: ${refused.message}`);
client.close();
