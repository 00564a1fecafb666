"""Server behaviour under overload, disconnects and slow clients; the figures of SECURITY.md.

    python benches/harden.py [--binary target/release/iplw] [--half-open 2000] [--only fair]

Uses only the standard library; starts its own servers on free ports of this machine. Takes about three minutes.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import multiprocessing
import os
import resource
import select
import socket
import statistics
import tempfile
import time
import urllib.parse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import asking
from asking import Server, ask, server

HEADER_SECONDS = 3


def long_world(connection: http.client.HTTPConnection) -> str:
    """A world of sixty boxes and 800,000 steps, reset."""
    bodies: list[dict[str, object]] = [
        {
            "name": f"b{i}",
            "shape": {"type": "box", "half_width": 0.2, "half_height": 0.2},
            "position": [0.45 * (i % 10), 0.3 + 0.45 * (i // 10)],
        }
        for i in range(60)
    ]
    bodies.append({"name": "ball", "shape": {"type": "disc", "radius": 0.1}})
    place = [{"target": "ball", "set": axis, "low": 1.0, "high": 9.0} for axis in ("x", "y")]
    place[0]["low"] = 8.0
    scene = {
        "format": "iplw.scene/1",
        "bodies": bodies,
        "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}],
        "goal": {"type": "contact", "bodies": ["ball", "b59"], "hold_s": 3.0},
        "gravity": [0, -9.8],
        "time_step": 0.01,
        "steps": 800_000,
        "observe_every": 10_000,
        "action": {"components": place},
    }
    status, made = ask(connection, "POST", "/v1/worlds", {"scene": scene, "kind": "sim"})
    assert status == 201, made
    assert ask(connection, "POST", f"/v1/worlds/{made['id']}/reset", {})[0] == 200
    return str(made["id"])


def processor_time(pid: int) -> float:
    """Processor time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def beyond_deadline(port: int) -> float:
    """Longest delay of a step's response after its deadline, s."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    world = long_world(connection)
    late = []
    for deadline in (0.2, 0.5, 1.0, 1.0, 0.5):
        begun = time.perf_counter()
        status, said = ask(
            connection, "POST", f"/v1/worlds/{world}/step", {"action": [0.5, 0.1]}, X_Deadline=str(deadline)
        )
        assert status == 503, said
        late.append(time.perf_counter() - begun - deadline)
    return max(late)


def freed(port: int, pid: int) -> float:
    """Longest time from a client's disconnect until its core is free, s."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    world = long_world(connection)
    took = []
    for _ in range(3):
        leaving = http.client.HTTPConnection("127.0.0.1", port)
        leaving.request("POST", f"/v1/worlds/{world}/step", json.dumps({"action": [0.5, 0.1]}))
        before = processor_time(pid)
        time.sleep(0.5)
        busy = processor_time(pid)
        assert busy - before > 0.1, "the server is computing"
        leaving.close()
        left = time.perf_counter()
        # If processor time is constant for 0.1 s, the core was free at the start of that interval.
        since, used = left, busy
        while time.perf_counter() - since < 0.1:
            now = processor_time(pid)
            if now > used:
                since, used = time.perf_counter(), now
            time.sleep(0.005)
        took.append(since - left)
    return max(took)


def p99(port: int, seconds: float) -> float:
    """99th percentile of the duration of trivial steps, s."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    times = []
    until = time.perf_counter() + seconds
    while time.perf_counter() < until:
        ask(connection, "POST", "/v1/worlds/bowling-sim/reset", {})
        begun = time.perf_counter()
        ask(connection, "POST", "/v1/worlds/bowling-sim/step", {"action": [0.5, 0.8, 0.3]})
        times.append(time.perf_counter() - begun)
    return statistics.quantiles(times, n=100)[98]


def half_open(port: int, count: int) -> tuple[int, float, float]:
    """Connections still open one second after the header timeout; another client's p99 before and during the attack, s."""
    quiet = p99(port, 2.0)
    waiting = []
    for _ in range(count):
        one = socket.create_connection(("127.0.0.1", port))
        one.send(b"GET /v1/worlds HTTP/1.1\r\nHost: local")
        waiting.append(one)
    begun = time.perf_counter()
    meanwhile = p99(port, 2.0)
    time.sleep(max(0.0, begun + HEADER_SECONDS + 1 - time.perf_counter()))
    poll = select.poll()
    for one in waiting:
        poll.register(one, select.POLLIN | select.POLLHUP | select.POLLRDHUP)
    ended = {number for number, _ in poll.poll(0)}
    still = count - len(ended)
    for one in waiting:
        one.close()
    return still, quiet, meanwhile


STEP = {"action": [0.5, 0.8, 0.3]}


def step_over_http(running: Server, token: str) -> Callable[[], float]:
    """Times a step; sends the token even if none is required, so that the client's work is the same."""
    connection, headers = running.connect(), {"Authorization": f"Bearer {token}"}

    def step() -> float:
        ask(connection, "POST", "/v1/worlds/bowling-sim/reset", {"seed": 1}, **headers)
        begun = time.perf_counter()
        status, _ = ask(connection, "POST", "/v1/worlds/bowling-sim/step", STEP, **headers)
        taken = time.perf_counter() - begun
        assert status == 200
        return taken

    return step


def step_over_zmq(running: Server, token: str | None) -> Callable[[], float]:
    assert running.zmq is not None
    one = asking.dealer(running.zmq, token)
    reset = asking.message("reset_world", {"id": "bowling-sim", "seed": 1})
    step_world = asking.message("step_world", {"id": "bowling-sim", **STEP})

    def step() -> float:
        one.sendall(reset)
        asking.frame(one)
        begun = time.perf_counter()
        one.sendall(step_world)
        answer = asking.frame(one)[1]
        taken = time.perf_counter() - begun
        assert asking.whole_over_zmq(b"\x02" + len(answer).to_bytes(8, "big") + answer)
        return taken

    return step


def cost(binary: str, transport: str, servers: int = 12) -> dict[str, tuple[float, float]]:
    """Duration of a step for its client, and the server's processor time for it and the preceding reset, s: without authentication;
    with a token and a log line; additionally with a data directory. Lower quartiles of alternating blocks of 25; medians over several
    servers each, which differ by the placement of their threads."""
    times: dict[str, list[float]] = {"open": [], "guarded": [], "kept": []}
    used: dict[str, list[float]] = {name: [] for name in times}
    for _ in range(servers):
        with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
            token = asking.new_token(binary, place, "bench")
            guards = ["--log", "json", "--token-file", str(Path(place, "tokens.json"))]
            options = {"open": [], "guarded": guards, "kept": ["--log", "json", "--data-dir", place]}
            ways = {name: stack.enter_context(server(binary, *more, zmq=True)) for name, more in options.items()}
            if transport == "http":
                steps = {name: step_over_http(way, token) for name, way in ways.items()}
            else:
                steps = {name: step_over_zmq(way, None if name == "open" else token) for name, way in ways.items()}
            turns: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
            for turn in range(16):
                for name in sorted(steps, reverse=turn % 2 == 1):
                    before = ways[name].processor_seconds()
                    taken = statistics.median(steps[name]() for _ in range(25))
                    turns[name].append((taken, (ways[name].processor_seconds() - before) / 25))
            for name, of in turns.items():
                times[name].append(statistics.quantiles([taken for taken, _ in of])[0])
                used[name].append(statistics.quantiles([processor for _, processor in of])[0])
    return {name: (statistics.median(times[name]), statistics.median(used[name])) for name in times}


# A light request, and one that takes about ten milliseconds on two cores.
WORK: dict[str, tuple[str, str, str, dict[str, object]]] = {
    "light": ("get_world", "GET", "/v1/worlds/bowling-sim", {}),
    "computing": (
        "rollout_world",
        "POST",
        "/v1/worlds/bowling-sim/rollout",
        {"task": "bowling:001", "actions": [7 * i for i in range(64)]},
    ),
}


def over_http(running: Server, token: str, work: str) -> tuple[Callable[[], socket.socket], bytes]:
    _, method, path, body = WORK[work]
    said = json.dumps(body) if body else ""
    head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\nContent-Length: {len(said)}\r\n\r\n"
    return partial(socket.create_connection, ("127.0.0.1", running.http)), (head + said).encode()


def over_zmq(running: Server, token: str, work: str) -> tuple[Callable[[], socket.socket], bytes]:
    assert running.zmq is not None
    op, _, _, body = WORK[work]
    return partial(asking.dealer, running.zmq, token), asking.message(op, {"id": "bowling-sim", **body})


def served(running: Server, transport: str, work: str, clients: dict[str, int], seconds: float) -> list[int]:
    """Number of responses of each client, by token, for clients that send requests over several connections without a pause."""
    way, whole = {"http": (over_http, asking.whole_over_http), "zmq": (over_zmq, asking.whole_over_zmq)}[transport]
    floods = []
    for token, count in clients.items():
        connect, request = way(running, token, work)
        ours, theirs = multiprocessing.Pipe()
        flooding = multiprocessing.Process(
            target=asking.flood, args=(connect, request, whole, count, seconds, theirs), daemon=True
        )
        flooding.start()
        floods.append((flooding, ours))
    for _, pipe in floods:
        assert pipe.recv() == "ready"
    for _, pipe in floods:
        pipe.send("go")
    counts = [int(pipe.recv()) for _, pipe in floods]
    for flooding, _ in floods:
        flooding.join()
    return counts


def share(
    running: Server, ann: str, bob: str, transport: str, work: str, connections: int, seconds: float
) -> tuple[float, float]:
    """What the second client is served of all while the first floods with 64 connections, over its fair half; and over that
    half or what it can do alone, whichever is less: over few connections it may not ask for its half."""
    (alone,) = served(running, transport, work, {bob: connections}, seconds)
    first, second = served(running, transport, work, {ann: 64, bob: connections}, seconds)
    half = (first + second) / 2
    over_half, over_wanted = second / half, second / min(half, alone)
    print(
        f"    {transport}, {work}, {connections} connections against 64: {second} of {first + second}, alone {alone}: "
        f"{over_half:.2f} of its half, {over_wanted:.2f} of what it could have"
    )
    return over_half, over_wanted


def share_of_jobs(running: Server, tokens: dict[str, str]) -> float:
    """Share of jobs relative to the fair half: the first client has 40 queued jobs when the second queues 8."""
    job = {"world": "bowling-sim", "split": "test", "attempts": 20}
    connection = running.connect()

    def queue(name: str) -> int:
        headers = {"Authorization": f"Bearer {tokens[name]}"}
        status, made = ask(connection, "POST", "/v1/policies/random/evaluate", job, **headers)
        assert status == 202, made
        return int(str(made["id"]).removeprefix("job-"))

    def ended(name: str) -> int:
        headers = {"Authorization": f"Bearer {tokens[name]}"}
        jobs = ask(connection, "GET", "/v1/jobs?limit=1000", **headers)[1]["jobs"]
        assert isinstance(jobs, list)
        return sum(row["state"] == "succeeded" for row in jobs)

    for _ in range(40):
        queue("ann")
    before = ended("ann")
    for _ in range(8):
        queue("bob")
    while (second := ended("bob")) < 8:
        time.sleep(0.02)
    first = ended("ann") - before
    print(f"    jobs, 8 against 40: {second} of {first + second}")
    return 2 * second / (first + second)


def fair(binary: str, seconds: float = 4.0) -> None:
    """Smallest share over all transports and workloads."""
    with tempfile.TemporaryDirectory() as place:
        tokens = {name: asking.new_token(binary, place, name) for name in ("ann", "bob")}
        with server(binary, "--data-dir", place, zmq=True) as running:
            ways = [
                (transport, work, connections)
                for transport in ("http", "zmq")
                for work in ("computing", "light")
                for connections in (1, 8, 64)
            ]
            shares = {way: share(running, tokens["ann"], tokens["bob"], *way, seconds) for way in ways}
            jobs = share_of_jobs(running, tokens)
    for transport in ("http", "zmq"):
        computing = min(half for way, (half, _) in shares.items() if way[:2] == (transport, "computing"))
        light = min(wanted for way, (_, wanted) in shares.items() if way[:2] == (transport, "light"))
        print(
            f"{transport}: the second client's share over its fair half, computing, {computing:.2f} at least; light, over what "
            f"it could have, {light:.2f} at least"
        )
    print(f"jobs: the second client's share over its fair half {jobs:.2f}")


def late_work(running: Server) -> None:
    """How long the server continues to compute after it abandoned a response, for requests other than simulations."""
    connection = running.connect()
    long = long_world(connection)
    film = urllib.parse.urlencode({"view": "filmstrip", "action": "0.5,0.1", "width": 4096})
    scene = urllib.parse.urlencode({"view": "scene", "width": 4096})
    many = {"task": "bowling:000", "count": 10_000}
    worlds = {"task": "bowling", "kind": "sim", "count": 4000}
    rows = "".join(f"{i // 500},{i % 500 / 100},{1.5 + i % 7},2.5\n" for i in range(800_000))
    reading = {"length_unit": "m", "time_unit": "s", "y_down": False}
    tracks = {"ball": {"radius": 0.02, "mass": 0.0027}, "trials": f"trial,t,x,y\n{rows}", "reading": reading}
    for name, method, path, body in (
        ("a picture of 4096 px", "GET", f"/v1/worlds/{long}/render?{scene}", None),
        ("a film of 4096 px", "GET", f"/v1/worlds/{long}/render?{film}", None),
        ("the ranking of 10,000 actions", "POST", "/v1/policies/random/act", many),
        ("4000 worlds made", "POST", "/v1/batch/worlds", worlds),
        (f"reading {len(rows) / 1e6:.0f} MB of tracks", "POST", "/v1/diagnoses", tracks),
    ):
        worst, given_up_on = 0.0, 0
        for deadline in (0.01, 0.03, 0.1, 0.2):
            status, _ = ask(connection, method, path, body, X_Deadline=str(deadline))
            if status != 503:
                continue
            given_up_on += 1
            given_up, before = time.perf_counter(), processor_time(running.pid)
            since, used = given_up, before
            while time.perf_counter() - since < 0.1:
                now = processor_time(running.pid)
                if now > used:
                    since, used = time.perf_counter(), now
                time.sleep(0.002)
            worst = max(worst, since - given_up)
        told = f"computes on for {1000 * worst:.0f} ms at most after its deadline" if given_up_on else "is done in time"
        print(f"{name}: {told}")


def after_jobs(binary: str, count: int = 66) -> tuple[float, float, float]:
    """Resident memory before, at the peak of, and after a flood of jobs (after cleanup), MB."""
    with tempfile.TemporaryDirectory() as place, server(binary, "--data-dir", place) as running:
        connection = running.connect()
        ask(connection, "GET", "/v1/worlds")
        before = most = running.resident()
        estimate = {"task": "bowling", "rounds": 1, "actions": 6, "samples": 64}
        for seed in range(count):
            status, said = ask(connection, "POST", "/v1/iplw", {**estimate, "seed": seed})
            assert status == 202, said
        while True:
            most = max(most, running.resident())
            jobs = ask(connection, "GET", "/v1/jobs?limit=1000")[1]["jobs"]
            assert isinstance(jobs, list)
            if all(row["state"] not in ("queued", "running") for row in jobs):
                assert all(row["state"] == "succeeded" for row in jobs)
                break
            time.sleep(0.2)
        time.sleep(12.0)
        return before, most, running.resident()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", default="target/release/iplw")
    parser.add_argument("--half-open", type=int, default=2000)
    parser.add_argument("--only", choices=["time", "cost", "fair", "memory"], action="append")
    arguments = parser.parse_args()
    wanted = arguments.only or ["time", "cost", "fair", "memory"]
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    if "time" in wanted:
        # All half-open connections belong to one client.
        limits = {"header_seconds": HEADER_SECONDS, "client_connections": 4096}
        with server(arguments.binary, limits=limits) as running:
            print(f"answered after its deadline: {1000 * beyond_deadline(running.http):.1f} ms")
            print(f"core freed after the client is gone: {1000 * freed(running.http, running.pid):.0f} ms")
            late_work(running)
            still, quiet, meanwhile = half_open(running.http, arguments.half_open)
            print(f"{arguments.half_open} half-open connections, still open after the header's time: {still}")
            print(f"p99 of another client's step: quiet {1000 * quiet:.2f} ms, meanwhile {1000 * meanwhile:.2f} ms")
    if "cost" in wanted:
        for transport in ("http", "zmq"):
            found = cost(arguments.binary, transport)
            step, used = found["open"]
            print(f"{transport}: a step takes {1e6 * step:.0f} us; processor time of a reset and a step {1e6 * used:.0f} us")
            for name, what in (("guarded", "a token and a line of the log"), ("kept", "a data directory besides")):
                more = found[name][1] - used
                print(
                    f"    with {what} {1e6 * more:+.1f} us of processor time, {100 * more / 2 / step:+.1f} % of a step by request, "
                    f"{100 * more / used:+.1f} % of the server's own; timed {100 * (found[name][0] / step - 1):+.1f} %"
                )
    if "fair" in wanted:
        fair(arguments.binary)
    if "memory" in wanted:
        before, most, after = after_jobs(arguments.binary)
        print(f"resident memory: {before:.1f} MB, in a flood of 66 jobs {most:.1f} MB, after it {after:.1f} MB")


if __name__ == "__main__":
    main()
