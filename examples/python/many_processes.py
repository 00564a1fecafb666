"""Many processes on one machine, without Ray: a sweep over seeds with joblib, with the tasks of `iplw.cluster`.

    pip install iplw joblib && python examples/python/many_processes.py --jobs 4

A task is a sequence of commands in a temporary directory; it ends with its parent process. Threads suffice for dispatch, as
the computation runs in subprocesses. Prints the friction estimated with each seed.
"""

from __future__ import annotations

import argparse
import os
from typing import Any

from joblib import Parallel, delayed

from iplw.cli import command, compute


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--task", default="bowling")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="concurrent tasks, each on one core")
    arguments = parser.parse_args()
    tasks = (delayed(estimate)(arguments.task, arguments.rounds, seed) for seed in range(arguments.seeds))
    # In order of the seeds.
    reports: list[dict[str, Any]] = Parallel(n_jobs=arguments.jobs, prefer="threads")(tasks)
    for seed, report in enumerate(reports):
        friction = next(latent for latent in report["latents"] if latent["name"] == "friction")
        low, high = friction["ci95"]
        identified = f"{low:.3f} to {high:.3f}" if friction["identifiable"] else "not identifiable from these trials"
        print(f"seed {seed}  friction {friction['value']:.4f}  ({identified})")


def estimate(task: str, rounds: int, seed: int) -> dict[str, Any]:
    """Report of `iplw estimate`."""
    argv = command("estimate", task=task, rounds=rounds, seed=seed, json=True)
    report: dict[str, Any] = compute([argv], threads=1).json()
    return report


if __name__ == "__main__":
    main()
