"""Many processes on one machine, without Ray: a sweep of seeds by joblib, each unit as `iplw.cluster` has them.

    pip install iplw joblib && python examples/python/many_processes.py --jobs 4

A unit is commands of the program in a directory of their own; it ends with the process that asked for it. Threads do
for handing them out, since it is the programs that compute. Prints the friction that each seed estimates.
"""

from __future__ import annotations

import argparse
import os
from typing import Any

from joblib import Parallel, delayed

from iplw.cli import command, compute


def main() -> None:
    values = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    values.add_argument("--task", default="bowling")
    values.add_argument("--seeds", type=int, default=4)
    values.add_argument("--rounds", type=int, default=2)
    values.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="units at a time, each on one core")
    arguments = values.parse_args()
    units = (delayed(estimate)(arguments.task, arguments.rounds, seed) for seed in range(arguments.seeds))
    # In the seeds' order, whichever ends first.
    reports: list[dict[str, Any]] = Parallel(n_jobs=arguments.jobs, prefer="threads")(units)
    for seed, report in enumerate(reports):
        friction = next(latent for latent in report["latents"] if latent["name"] == "friction")
        low, high = friction["ci95"]
        identified = f"{low:.3f} to {high:.3f}" if friction["identifiable"] else "not told by these trials"
        print(f"seed {seed}  friction {friction['value']:.4f}  ({identified})")


def estimate(task: str, rounds: int, seed: int) -> dict[str, Any]:
    """A report of `iplw estimate`."""
    argv = command("estimate", task=task, rounds=rounds, seed=seed, json=True)
    report: dict[str, Any] = compute([argv], threads=1).json()
    return report


if __name__ == "__main__":
    main()
