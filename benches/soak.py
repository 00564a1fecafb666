"""Soak test: a mixed load and the server's memory growth: `make soak`, or `make soak MINUTES=10`.

    python benches/soak.py [--binary target/release/iplw] [--minutes 60]

Over HTTP and ZeroMQ: worlds are created, reset, stepped, rolled out, rendered and deleted; policies evaluated; jobs queued, followed
and deleted; invalid requests sent; connections opened and closed. Resident memory is sampled every second. The first tenth is warm-up;
the means of both halves of the rest are compared. Exit status 1 if a response is unexpected, or memory grows by more than
`--growth`.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Iterator

import asking
from asking import Server, ask, server

ACTION = {"action": [0.5, 0.8, 0.3]}


def over_http(running: Server, headers: dict[str, str]) -> Iterator[None]:
    """Rounds of all client operations, one request at a time."""
    connection = running.connect()

    def expect(status: int, method: str, path: str, body: object = None) -> dict[str, object]:
        got, answer = ask(connection, method, path, body, **headers)
        if got != status:
            raise AssertionError(f"{method} {path}: {got} {answer}")
        return answer

    for n in itertools.count():
        world = expect(201, "POST", "/v1/worlds", {"task": "bowling", "kind": "sim", "seed": n})["id"]
        yield
        for _ in range(20):
            expect(200, "POST", f"/v1/worlds/{world}/reset", {})
            expect(200, "POST", f"/v1/worlds/{world}/step", ACTION)
            yield
        actions = [(n * 31 + i * 7) % 9000 for i in range(64)]
        expect(200, "POST", f"/v1/worlds/{world}/rollout", {"actions": actions, "trajectories": n % 4 == 0})
        yield
        connection.request("GET", f"/v1/worlds/{world}/render?width=256", headers=headers)
        answer = connection.getresponse()
        assert answer.status == 200 and answer.read()
        yield
        expect(200, "POST", "/v1/policies/random/act", {"task": "bowling:003", "count": 5})
        expect(404, "GET", f"/v1/worlds/none-{n}")
        expect(200, "POST", f"/v1/worlds/{world}/reset", {})
        expect(422, "POST", f"/v1/worlds/{world}/step", {"action": [2.0, 0.0, 0.0]})
        expect(204, "DELETE", f"/v1/worlds/{world}")
        yield
        if n % 10 == 9:
            connection.close()


def jobs(running: Server, headers: dict[str, str]) -> Iterator[None]:
    """Small jobs in sequence, each deleted after its end."""
    connection = running.connect()
    for n in itertools.count():
        estimate = {"task": "bowling", "rounds": 1, "actions": 4, "samples": 32, "seed": n}
        status, job = ask(connection, "POST", "/v1/iplw", estimate, **headers)
        assert status == 202, job
        while job["state"] in ("queued", "running"):
            yield
            time.sleep(0.1)
            status, job = ask(connection, "GET", f"/v1/jobs/{job['id']}", **headers)
            assert status == 200, job
        assert job["state"] == "succeeded", job
        connection.request("DELETE", f"/v1/jobs/{job['id']}", headers=headers)
        assert connection.getresponse().read() == b""
        yield


def over_zmq(running: Server, token: str) -> Iterator[None]:
    """Resets and steps over ZeroMQ, on short-lived connections."""
    assert running.zmq is not None
    reset = asking.message("reset_world", {"id": "bowling-sim"})
    step = asking.message("step_world", {"id": "bowling-sim", **ACTION})
    while True:
        with asking.dealer(running.zmq, token) as one:
            for _ in range(200):
                for sent in (reset, step):
                    one.sendall(sent)
                    assert asking.frame(one)[1]
                yield


def keep_on(rounds: Iterator[None], until: float, pause: float, failed: list[str], counts: list[int]) -> None:
    try:
        for count, _ in enumerate(rounds):
            if time.monotonic() > until:
                counts.append(count)
                return
            time.sleep(pause)
    except Exception as e:  # noqa: BLE001 - whatever it is, it is a failure of the soak
        failed.append(repr(e))


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    given.add_argument("--binary", default="target/release/iplw")
    given.add_argument("--minutes", type=float, default=60.0)
    given.add_argument("--growth", type=float, default=0.01, help="maximum relative growth of the second half over the first")
    given.add_argument("--pause", type=float, default=0.005, help="pause between two requests of a client, s")
    arguments = given.parse_args()
    failed: list[str] = []
    counts: list[int] = []
    seen: list[float] = []
    with tempfile.TemporaryDirectory() as place:
        token = asking.new_token(arguments.binary, place, "soak")
        with server(arguments.binary, "--data-dir", place, "--log", "json", zmq=True) as running:
            headers = {"Authorization": f"Bearer {token}"}
            until = time.monotonic() + 60 * arguments.minutes
            clients = [over_http(running, headers) for _ in range(4)]
            clients += [over_zmq(running, token) for _ in range(2)] + [jobs(running, headers)]
            threads = [
                threading.Thread(target=keep_on, args=(client, until, arguments.pause, failed, counts))
                for client in clients
            ]
            for thread in threads:
                thread.start()
            while time.monotonic() < until and not failed:
                seen.append(running.resident())
                time.sleep(1.0)
            until = time.monotonic()
            for thread in threads:
                thread.join(timeout=60)
    warm = seen[len(seen) // 10 :]
    first, last = statistics.mean(warm[: len(warm) // 2]), statistics.mean(warm[len(warm) // 2 :])
    tenths = [statistics.mean(seen[len(seen) * i // 10 : len(seen) * (i + 1) // 10]) for i in range(10)]
    print(f"{arguments.minutes:g} minutes, {sum(counts)} rounds; resident MB by tenths: " + " ".join(f"{t:.1f}" for t in tenths))
    print(f"second half over the first, after a tenth: {100 * (last / first - 1):+.2f} %")
    for what in failed:
        print(f"failed: {what}")
    return int(bool(failed) or last / first - 1 > arguments.growth)


if __name__ == "__main__":
    sys.exit(main())
