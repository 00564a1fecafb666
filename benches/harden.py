"""What a server does with those who ask too much, leave, or take their time; the figures of SECURITY.md.

    python benches/harden.py [--binary target/release/iplw] [--half-open 2000]

Only the standard library; a server of its own on a free port of this machine. About half a minute.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import resource
import select
import socket
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

HEADER_SECONDS = 3


@contextlib.contextmanager
def server(binary: str, *arguments: str, limits: dict[str, float] | None = None) -> Iterator[tuple[int, int]]:
    """Port and process number of a server."""
    with tempfile.TemporaryDirectory() as place:
        file = Path(place, "limits.json")
        file.write_text(json.dumps(limits or {}))
        command = [binary, "serve", "--http", "127.0.0.1:0", "--limits", str(file), *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert process.stdout is not None
            yield int(process.stdout.readline().rsplit(":", 1)[1]), process.pid
        finally:
            process.terminate()
            process.wait()


def ask(
    connection: http.client.HTTPConnection, method: str, path: str, body: object = None, **headers: str
) -> tuple[int, dict[str, object]]:
    said = None if body is None else json.dumps(body)
    connection.request(method, path, said, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    return answer.status, json.loads(answer.read() or b"{}")


def long_world(connection: http.client.HTTPConnection) -> str:
    """A world of sixty boxes and a million steps, reset."""
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
        "steps": 1_000_000,
        "observe_every": 10_000,
        "action": {"components": place},
    }
    status, made = ask(connection, "POST", "/v1/worlds", {"scene": scene, "kind": "sim"})
    assert status == 201, made
    assert ask(connection, "POST", f"/v1/worlds/{made['id']}/reset", {})[0] == 200
    return str(made["id"])


def processor_time(pid: int) -> float:
    """Seconds of processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def beyond_deadline(port: int) -> float:
    """Longest that a step was answered after its deadline, s."""
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
    """Longest from a client's leaving to its core's being free, s."""
    connection = http.client.HTTPConnection("127.0.0.1", port)
    world = long_world(connection)
    took = []
    for _ in range(3):
        leaving = http.client.HTTPConnection("127.0.0.1", port)
        leaving.request("POST", f"/v1/worlds/{world}/step", json.dumps({"action": [0.5, 0.1]}))
        before = processor_time(pid)
        time.sleep(0.5)
        busy = processor_time(pid)
        assert busy - before > 0.1, "it is at work"
        leaving.close()
        left = time.perf_counter()
        # When the time used stands still for 0.1 s, it stood still at the beginning of that.
        since, used = left, busy
        while time.perf_counter() - since < 0.1:
            now = processor_time(pid)
            if now > used:
                since, used = time.perf_counter(), now
            time.sleep(0.005)
        took.append(since - left)
    return max(took)


def p99(port: int, seconds: float) -> float:
    """The time that 99 of 100 trivial steps stay below, s."""
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
    """Connections still open a second after the header's time; p99 of another client before and meanwhile, s."""
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


def cost(binary: str) -> float:
    """How much longer a step takes with a token and a line of the log; medians, in turns."""
    with tempfile.TemporaryDirectory() as place:
        new = [binary, "token", "new", "bench", "--may", "act", "--data-dir", place]
        token = subprocess.run(new, check=True, capture_output=True, text=True).stdout.strip()
        with contextlib.ExitStack() as stack:
            plain, _ = stack.enter_context(server(binary))
            guarded, _ = stack.enter_context(server(binary, "--data-dir", place, "--log", "json"))
            ways = {
                "plain": (http.client.HTTPConnection("127.0.0.1", plain), {}),
                "guarded": (http.client.HTTPConnection("127.0.0.1", guarded), {"Authorization": f"Bearer {token}"}),
            }
            times: dict[str, list[float]] = {"plain": [], "guarded": []}
            for _ in range(30):
                for name, (connection, headers) in ways.items():
                    for _ in range(50):
                        ask(connection, "POST", "/v1/worlds/bowling-sim/reset", {"seed": 1}, **headers)
                        begun = time.perf_counter()
                        ask(connection, "POST", "/v1/worlds/bowling-sim/step", {"action": [0.5, 0.8, 0.3]}, **headers)
                        times[name].append(time.perf_counter() - begun)
            return statistics.median(times["guarded"]) / statistics.median(times["plain"]) - 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", default="target/release/iplw")
    parser.add_argument("--half-open", type=int, default=2000)
    arguments = parser.parse_args()
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with server(arguments.binary, limits={"header_seconds": HEADER_SECONDS}) as (port, pid):
        print(f"answered after its deadline: {1000 * beyond_deadline(port):.1f} ms")
        print(f"core freed after the client is gone: {1000 * freed(port, pid):.0f} ms")
        still, quiet, meanwhile = half_open(port, arguments.half_open)
        print(f"{arguments.half_open} half-open connections, still open after the header's time: {still}")
        print(f"cost of a token and a line of the log on a step: {100 * cost(arguments.binary):.1f} %")
        print(f"p99 of another client's step: quiet {1000 * quiet:.2f} ms, meanwhile {1000 * meanwhile:.2f} ms")


if __name__ == "__main__":
    main()
