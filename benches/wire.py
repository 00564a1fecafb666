"""Cost of a step over the network, compared with a bare request and with other servers; `make bench-wire` runs it.

    python benches/wire.py --bin target/release/iplw --echo target/release/examples/echo \\
        --in-process target/release/examples/in_process [--peers PYTHON] [--out FILE.json]

Server and client share the machine's cores. Measurements are made in rounds that contain all rows, so that disturbances
affect all rows; a row is its fastest round, a ratio the median over rounds. Single requests are medians. A single step is
one step in a freshly reset world with one ball and one time step; for the other servers see `wire_peers.py`.

| row | what is measured |
|---|---|
| step | `World.step`: from the action array to observation, reward and info |
| bare | the step's message sent to an echo server: by urllib3 over HTTP, by pyzmq over ZeroMQ |
| packing | the part of a step without network: serialisation of the request, parsing of a response |
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import urllib3
import zmq
from gymnasium.vector import AutoresetMode

import iplw
from iplw import World, codec, frames, http, requests
from iplw.vector import PlacementVectorEnv

SCENE = {
    "format": "iplw.scene/1",
    "name": "trivial",
    "steps": 1,
    "bodies": [
        {"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1]},
        {"name": "other", "shape": {"type": "disc", "radius": 0.1}, "position": [1, 1]},
    ],
    "statics": [{"name": "ground", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
    "goal": {"type": "inside", "body": "ball", "region": [[2, 0], [3, 0], [3, 1], [2, 1]]},
    "action": {
        "components": [
            {"target": "ball", "set": "vx", "low": 0, "high": 5},
            {"target": "ball", "set": "vy", "low": 0, "high": 5},
            {"target": "ball", "set": "omega", "low": 0, "high": 5},
        ]
    },
}
ACTION = np.array([0.5, 0.5, 0.2])
PEERS = ["openenv", "dm_env_rpc", "flask", "flask_urllib3"]
BATCH = 256
#: Consecutive requests of one kind.
BLOCK = 50


def main() -> None:
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    given.add_argument("--bin", default="target/release/iplw")
    given.add_argument("--echo", default="target/release/examples/echo")
    given.add_argument("--in-process", default="target/release/examples/in_process")
    given.add_argument("--peers", help="Python interpreter with openenv-core, dm_env_rpc, flask and requests")
    given.add_argument("--rounds", type=int, default=5)
    given.add_argument("--steps", type=int, default=1000)
    given.add_argument("--batches", type=int, default=20, help="number of batches for the vector environment")
    given.add_argument("--out")
    arguments = given.parse_args()
    rounds: list[dict[str, float]] = []
    for k in range(arguments.rounds):
        row = {**wire(arguments), **vectors(arguments)}
        if arguments.peers:
            row |= peers(arguments)
        rounds.append(row)
        print(f"round {k + 1}: " + ", ".join(f"{name} {us:.0f}" for name, us in row.items()), file=sys.stderr)
    best = {name: min(row[name] for row in rounds) for name in rounds[0]}
    ratios = {name: statistics.median(of(row) for row in rounds) for name, of in RATIOS.items() if of_can(of, best)}
    print("\n| | us | a second |\n|---|---|---|")
    for name, us in best.items():
        print(f"| {name} | {us:.1f} | {1e6 / us:.0f} |")
    print("\n| ratio | |\n|---|---|")
    for name, ratio in ratios.items():
        print(f"| {name} | {ratio:.2f} |")
    if arguments.out:
        Path(arguments.out).write_text(json.dumps({"best_us": best, "ratios": ratios, "rounds": rounds}, indent=1))


def wire(arguments: argparse.Namespace) -> dict[str, float]:
    """Microseconds of single steps and of steps in batches, over both transports, and of bare requests."""
    row: dict[str, float] = {}
    with ExitStack() as stack:
        ours = stack.enter_context(serving([arguments.bin, "serve", *LISTEN, "--exit-with-stdin"]))
        echo = stack.enter_context(serving([arguments.echo, *LISTEN]))
        bares_of = {"http": bare_http_of(echo["http"]), "tcp": bare_zmq_of(echo["tcp"])}
        clients = {name: iplw.Client(ours[name], timeout=60) for name in ("http", "tcp")}
        for name, bares in bares_of.items():
            client = clients[name]
            made = client._connection.do(requests.create_worlds({"scene": SCENE}, arguments.steps))
            ids = made["worlds"]
            worlds = [World(client._connection, {"id": id}) for id in ids]
            client._connection.do(requests.reset_worlds(ids, [0] * len(ids), None, None, None))
            for _ in range(200):
                for bare in bares:
                    bare()
            for world in worlds[:100]:
                world.step(ACTION)
            # Alternating, since the machine's speed varies, but in blocks, since an idle server sleeps between requests.
            names = [f"{name} step", f"{name} bare", f"{name} packing"]
            took: dict[str, list[float]] = {row: [] for row in names}
            rest = iter(worlds[100:])
            steps = [lambda: next(rest).step(ACTION), *bares]
            for _ in range(len(worlds[100:]) // BLOCK):
                for times, work in zip(took.values(), steps):
                    for _ in range(BLOCK):
                        start = time.perf_counter()
                        work()
                        times.append(time.perf_counter() - start)
            # The median is robust against other load on the machine.
            row |= {name: 1e6 * statistics.median(times) for name, times in took.items()}
            row[f"{name} step in a batch of {BATCH}"] = batched(client, ids[:BATCH])
            client._connection.do(requests.delete_worlds(ids))
            client.close()
    return row


def batched(client: iplw.Client, ids: list[str], batches: int = 30) -> float:
    """Microseconds per step in a batch: the duration of `step_worlds` divided by the number of worlds."""
    actions = np.random.default_rng(0).random((len(ids), 3))
    took = []
    for _ in range(batches):
        client._connection.do(requests.reset_worlds(ids, [0] * len(ids), None, None, None))
        start = time.perf_counter()
        client._connection.do(requests.step_worlds(ids, actions, "disabled", None))
        took.append(time.perf_counter() - start)
    return 1e6 * statistics.median(took) / len(ids)


def vectors(arguments: argparse.Namespace) -> dict[str, float]:
    """Microseconds per valid rollout of a 256-wide vector environment, and of the library on the same actions."""
    row: dict[str, float] = {}
    with serving([arguments.bin, "serve", *LISTEN, "--exit-with-stdin"]) as ours:
        for name in ("http", "tcp"):
            envs = PlacementVectorEnv(
                BATCH, "bowling", url=ours[name], autoreset_mode=AutoresetMode.SAME_STEP, timeout=120
            )
            _, infos = envs.reset(seed=1)
            envs.action_space.seed(1)
            sampled = [envs.action_space.sample() for _ in range(arguments.batches)]
            tasks, work, valid, spent = list(infos["task"]), [], 0, 0.0
            for actions in sampled:
                work.append([[task, action.tolist()] for task, action in zip(tasks, actions.astype(float))])
                start = time.perf_counter()
                _, _, ended, _, infos = envs.step(actions)
                spent += time.perf_counter() - start
                valid += int(ended.sum())
                tasks = list(infos["task"])
            row[f"{name} rollout in a vector of {BATCH}"] = 1e6 * spent / valid
            envs.close()
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump({"batches": work}, file)
        file.flush()
        said = json.loads(subprocess.check_output([arguments.in_process, file.name, "2"]))
    assert said["valid"] == valid, "equal numbers of valid actions"
    row["in-process rollout"] = 1e6 * said["seconds"] / valid
    return row


def peers(arguments: argparse.Namespace) -> dict[str, float]:
    """Microseconds per single step of the other servers; none has batches, so 256 steps take 256 times as long."""
    script = str(Path(__file__).with_name("wire_peers.py"))
    row: dict[str, float] = {}
    for name in PEERS:
        port = free_port()
        server = subprocess.Popen(
            [arguments.peers, script, "serve", name, str(port)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        try:
            until = time.monotonic() + 60
            while True:
                try:
                    socket.create_connection(("127.0.0.1", port), 1).close()
                    break
                except OSError:
                    if time.monotonic() > until:
                        raise
                    time.sleep(0.1)
            drive = [arguments.peers, script, "drive", name, str(port), str(arguments.steps)]
            said = json.loads(subprocess.check_output(drive, stderr=subprocess.DEVNULL))
            row[name] = said["us"]
        finally:
            server.kill()
            server.wait()
    return row


LISTEN = ["--http", "127.0.0.1:0", "--zmq", "tcp://127.0.0.1:0"]
IN_BATCH = f"step in a batch of {BATCH}"
HTTP_PEERS = ["openenv", "flask", "flask_urllib3"]
RATIOS: dict[str, Callable[[dict[str, float]], float]] = {
    "HTTP step / bare request (at most 1.3)": lambda r: r["http step"] / r["http bare"],
    "ZeroMQ step / bare echo (at most 1.3)": lambda r: r["tcp step"] / r["tcp bare"],
    "best HTTP peer / HTTP step": lambda r: min(r[p] for p in HTTP_PEERS) / r["http step"],
    "best HTTP peer / ZeroMQ step (at least 3)": lambda r: min(r[p] for p in HTTP_PEERS) / r["tcp step"],
    "dm_env_rpc / ZeroMQ step": lambda r: r["dm_env_rpc"] / r["tcp step"],
    "best HTTP peer / HTTP step in a batch (at least 50)": lambda r: min(r[p] for p in HTTP_PEERS)
    / r[f"http {IN_BATCH}"],
    "best HTTP peer / ZeroMQ step in a batch (at least 50)": lambda r: min(r[p] for p in HTTP_PEERS)
    / r[f"tcp {IN_BATCH}"],
    "rollouts a second, vector over HTTP / in-process (at least 0.9)": lambda r: r["in-process rollout"]
    / r[f"http rollout in a vector of {BATCH}"],
    "rollouts a second, vector over ZeroMQ / in-process (at least 0.9)": lambda r: r["in-process rollout"]
    / r[f"tcp rollout in a vector of {BATCH}"],
}


def of_can(of: Callable[[dict[str, float]], float], row: dict[str, float]) -> bool:
    """Whether the rows of a ratio are available."""
    try:
        of(row)
    except KeyError:
        return False
    return True


#: Request and response of a step.
CALL = requests.step("w00000000-1000", np.array([0.5, 0.5, 0.2]))
ANSWER = {
    "observation": [0.10770566239316239, 0.5420026881720431, 0.08012820512820512] * 2,
    "reward": 0.0,
    "terminated": True,
    "truncated": False,
    "info": {
        **{"valid": True, "solved": False, "steps": 1, "task": "custom:trivial", "interactions": 1},
        **{"collisions": 0, "rolling_steps": 0, "end": "horizon"},
    },
}


def bare_http_of(url: str) -> list[Callable[[], Any]]:
    """A step's request to an echo handler over a keep-alive connection; and serialisation alone."""
    pool = urllib3.connection_from_url(url)
    path, headers, body = http.encode_request(CALL)
    said = codec.pack(ANSWER)

    def packing() -> Any:
        call = requests.step("w00000000-1000", ACTION)
        http.encode_request(call)
        return call.read(codec.unpack(said))

    return [
        lambda: pool.urlopen("POST", path, body=body, headers=headers, retries=False).data,
        packing,
    ]


def bare_zmq_of(url: str) -> list[Callable[[], Any]]:
    """A step's message to an echoing ROUTER; and serialisation alone."""
    dealer: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
    dealer.linger = 0
    dealer.connect(url)
    message = frames.encode_request(1000, CALL)
    said = codec.pack({"v": 1, "id": 1000, "ok": True, "result": ANSWER, "arrays": []})

    def ask() -> Any:
        dealer.send_multipart(message)
        return dealer.recv_multipart()

    def packing() -> Any:
        call = requests.step("w00000000-1000", ACTION)
        frames.encode_request(1000, call)
        return call.read(frames.decode_reply(frames.decode_header([said]), [said], False))

    return [ask, packing]


@contextmanager
def serving(command: list[str]) -> Iterator[dict[str, str]]:
    """Starts a server and yields its addresses by scheme (HTTP and ZeroMQ)."""
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        found: dict[str, str] = {}
        while len(found) < 2:
            line = server.stdout.readline()
            if not line:
                raise SystemExit(f"{command[0]} ended without saying where it listens")
            if "listening on " in line:
                address = line.partition("listening on ")[2].strip()
                found[address.partition(":")[0]] = address
        yield found
    finally:
        server.kill()
        server.wait()


def free_port() -> int:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return int(held.getsockname()[1])


if __name__ == "__main__":
    main()
