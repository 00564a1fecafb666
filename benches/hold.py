"""Keeps a server under load and measures latency and memory: `make bench-hold`; the full figure with `--seconds 300`.

    python benches/hold.py --bin target/release/iplw --seconds 20

A thousand sessions stay open. Sixty-four clients act in them, half over HTTP and half over ZeroMQ, each in its own thread
in one of a few processes: resets, steps and occasional batches. Prints one line of JSON: requests, errors (none is
allowed), latency in ms (median, p99, maximum), the server's maximum number of threads, its resident memory at each tenth
of the time, and its relative growth from the third to the last tenth. Exit status 1 if there was an error or memory grew
by more than `--growth`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import iplw

SESSIONS, CLIENTS, PROCESSES = 1000, 64, 4


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    given.add_argument("--bin", default="target/release/iplw")
    given.add_argument("--seconds", type=float, default=20.0)
    given.add_argument("--growth", type=float, default=0.10, help="maximum relative growth of resident memory")
    arguments = given.parse_args()
    server = subprocess.Popen(
        [arguments.bin, "serve", "--http", "127.0.0.1:0", "--zmq", "tcp://127.0.0.1:0", "--exit-with-stdin"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert server.stdout is not None
        lines = [server.stdout.readline(), server.stdout.readline()]
        urls = [line.partition("listening on ")[2].strip() for line in lines]
        figures = hold(urls, server.pid, arguments.seconds)
    finally:
        server.kill()
        server.wait()
    print(json.dumps(figures))
    return int(bool(figures["errors"]) or figures["rss_growth"] > arguments.growth)


def hold(urls: Sequence[str], pid: int, seconds: float) -> dict[str, Any]:
    """Figures of a run."""
    with iplw.Client(urls[0], timeout=60) as client:
        worlds = [client.create_world("bowling").id for _ in range(SESSIONS)]
        context = multiprocessing.get_context("spawn")
        share = CLIENTS // PROCESSES
        with context.Pool(PROCESSES) as pool:
            # The clock starts once every process is running: imports take seconds on a busy machine.
            pool.map(time.sleep, [0.2] * PROCESSES, chunksize=1)
            end = time.time() + seconds
            parts = [
                pool.apply_async(clients, (urls, worlds, range(k * share, (k + 1) * share), end))
                for k in range(PROCESSES)
            ]
            memory, threads = [], 0
            for k in range(10):
                time.sleep(max(0.0, end - seconds * (9 - k) / 10 - time.time()))
                memory.append(resident(pid))
                threads = max(threads, len(list(Path(f"/proc/{pid}/task").iterdir())))
            done = [part.get() for part in parts]
        still = len(client.worlds())
    took = np.concatenate([np.asarray(times) for times, _ in done]) * 1e3
    errors = [error for _, found in done for error in found]
    return {
        "seconds": seconds,
        "sessions": still,
        "clients": CLIENTS,
        "requests": len(took),
        "requests_per_s": round(len(took) / seconds),
        "errors": len(errors),
        "first_errors": errors[:3],
        "median_ms": round(float(np.median(took)), 2),
        "p99_ms": round(float(np.percentile(took, 99)), 2),
        "worst_ms": round(float(took.max()), 2),
        "threads": threads,
        "rss_mb": [round(bytes / 2**20, 1) for bytes in memory],
        # Caches and pools fill at the start; later growth may be a leak.
        "rss_growth": round(memory[-1] / memory[2] - 1, 4),
    }


def clients(
    urls: Sequence[str], worlds: Sequence[str], numbers: range, end: float
) -> tuple[list[float], list[str]]:
    """Clients of one process, one thread each: durations of requests, s, and errors."""
    times: list[float] = []
    errors: list[str] = []

    def act(number: int) -> None:
        rng = np.random.default_rng(number)
        mine = worlds[number::CLIENTS]
        try:
            with iplw.Client(urls[number % 2], timeout=30) as client:
                handles = [client.world(id) for id in mine]
                while time.time() < end:
                    world = handles[int(rng.integers(len(handles)))]
                    clock(times, lambda: world.reset(seed=int(rng.integers(2**32))))
                    for _ in range(4):
                        # Until an action can be placed, which ends the episode.
                        if clock(times, lambda: world.step(rng.random(3)))[2]:
                            break
                    if rng.random() < 0.05:
                        clock(times, lambda: world.rollout(rng.random((8, 3)), trajectories=True))
        except Exception as error:
            errors.append(f"{type(error).__name__}: {error}")

    threads = [threading.Thread(target=act, args=(number,)) for number in numbers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return times, errors


def clock(times: list[float], work: Any) -> Any:
    start = time.perf_counter()
    result = work()
    times.append(time.perf_counter() - start)
    return result


def resident(pid: int) -> int:
    """Resident memory of a process, bytes."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096


if __name__ == "__main__":
    sys.exit(main())
