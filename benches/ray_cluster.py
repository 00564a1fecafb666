"""Speed-up by a second node and overhead of Ray, on this machine: `python benches/ray_cluster.py` (about 4 minutes).

    IPLW_BIN=target/release/iplw .venv/bin/python benches/ray_cluster.py

A local Ray cluster of two nodes with one core each, warm, beside one process of one core:

- `speedup`: equal estimations at the paper's scale, in sequence in one process, then on the cluster. Their reports must be
  bit-identical.
- `lost`: estimations during which a third node is removed; the reports must be bit-identical.
- `overhead`: a unit of about 2 s, alternately in one process and on the cluster, the median of each; and the same for a unit
  that only sleeps, which is insensitive to other load.

Prints one line of JSON, in s and as ratios. Exit status 1 if bits differ. Needs two idle cores.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

# Without this, Ray's workers run at a lower priority than the single process.
os.environ["RAY_worker_niceness"] = "0"
os.environ["RAY_USAGE_STATS_ENABLED"] = "0"

import ray
from ray.cluster_utils import Cluster

from iplw import cluster
from iplw.cli import command, compute

T = TypeVar("T")
#: Duration of a unit of work for measuring Ray's overhead, s.
UNIT = 2.0


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    given.add_argument("--units", type=int, default=2, help="number of estimations, even")
    given.add_argument("--rounds", type=int, default=10, help="rounds per estimation (10 in the paper)")
    given.add_argument("--pairs", type=int, default=7, help="units of 2 s, on each side")
    arguments = given.parse_args()
    if arguments.units < 2 or arguments.units % 2:
        given.error(f"--units is {arguments.units}; allowed: an even number from 2")
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    nodes.add_node(num_cpus=1)
    ray.init(address=nodes.address, log_to_driver=False, logging_level="error")
    try:
        warm(2)
        # The paper's scale: 1000 samples, 200 elites, once a round.
        paper = command("estimate", task="bowling", preset="paper", rounds=arguments.rounds, seed=1, json=True)
        found = {
            "speedup": speedup(paper, arguments.units),
            "overhead": overhead(arguments.pairs),
            "lost": lost(nodes, command("estimate", task="bowling", preset="paper", rounds=2, seed=1, json=True)),
        }
    finally:
        ray.shutdown()
        nodes.shutdown()
    print(json.dumps(found))
    return 0 if found["speedup"]["equal"] and found["lost"]["equal"] else 1


def report(argv: list[str]) -> dict[str, Any]:
    """Report of a command without its duration."""
    found: dict[str, Any] = compute([argv], threads=1).json()
    del found["seconds"]
    return found


def timed(work: Callable[[], T]) -> tuple[float, T]:
    started = time.perf_counter()
    done = work()
    return time.perf_counter() - started, done


def warm(cores: int) -> None:
    """Warms up each node: starts a worker, imports the package and queries the program's version."""
    while len({ran.node for ran in cluster.map(time.sleep, [0.5] * 2 * cores, progress=False).ran if ran}) < cores:
        pass


def speedup(argv: list[str], units: int) -> dict[str, Any]:
    """Speed-up of the nodes over a single process for equal estimations."""
    one, alone = timed(lambda: [report(argv) for _ in range(units)])
    two, found = timed(lambda: cluster.map(report, [argv] * units, progress=False))
    apart = len({ran.node for ran in found.ran if ran})
    return {"one_s": one, "two_s": two, "ratio": one / two, "nodes": apart, "equal": found == alone}


def overhead(pairs: int) -> dict[str, float]:
    """Relative overhead of the cluster per unit of work."""
    rounds = max(1, round(UNIT / timed(lambda: report(bowling(1)))[0]))
    sides: dict[str, list[float]] = {"here_s": [], "there_s": [], "asleep_s": []}
    for _ in range(pairs):
        sides["here_s"].append(timed(lambda: report(bowling(rounds)))[0])
        sides["there_s"].append(timed(lambda: cluster.map(report, [bowling(rounds)], progress=False))[0])
        sides["asleep_s"].append(timed(lambda: cluster.map(time.sleep, [UNIT], progress=False))[0])
    found = {name: statistics.median(values) for name, values in sides.items()}
    return {
        **found,
        "share": found["there_s"] / found["here_s"] - 1.0,
        "share_asleep": found["asleep_s"] / UNIT - 1.0,
    }


def bowling(rounds: int) -> list[str]:
    return command("estimate", task="bowling", actions=12, rounds=rounds, seed=1, json=True)


def lost(nodes: Any, argv: list[str]) -> dict[str, Any]:
    """Node failure: a third node joins, receives a unit and is terminated a second later."""
    doomed = nodes.add_node(num_cpus=1)
    warm(3)
    remove = threading.Timer(1.0, nodes.remove_node, [doomed], {"allow_graceful": False})
    remove.start()
    seconds, found = timed(lambda: cluster.map(report, [argv] * 3, progress=False))
    remove.join()
    survivors = all(ran is not None and ran.node != doomed.node_id for ran in found.ran)
    return {"s": seconds, "equal": found == [report(argv)] * 3, "nowhere_lost": survivors}


if __name__ == "__main__":
    sys.exit(main())
