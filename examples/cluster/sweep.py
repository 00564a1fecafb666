"""A sweep of estimations over worlds and seeds, written as a table; runs on the cluster at RAY_ADDRESS, or on this machine.

    pip install 'iplw[ray]' && python examples/cluster/sweep.py --seeds 4 --out sweep.csv

`rayjob.yaml` (Kubernetes) and `slurm.sh` run this file. The table is byte-identical for any number of nodes, including
nodes lost during the sweep.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

from iplw import cluster


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--task", default="bowling")
    parser.add_argument("--damping", type=float, nargs="+", default=[0.8, 0.9], help="damping of the hidden worlds, 1/s")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--num-cpus", type=int, default=1, help="CPUs per estimation")
    parser.add_argument("--out", type=Path, default=Path("sweep.csv"))
    arguments = parser.parse_args()
    result = cluster.estimate(
        arguments.task,
        over={"real": [{"damping": damping} for damping in arguments.damping]},
        seeds=range(arguments.seeds),
        settings={"rounds": arguments.rounds},
        num_cpus=arguments.num_cpus,
        # Cluster nodes may be preempted; the tasks on a lost node are retried.
        tries=10,
    )
    with arguments.out.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["damping", "seed", "latent", "value", "low", "high", "identifiable"])
        for item, report in zip(result.items, result, strict=True):
            for latent in report["latents"]:
                row = [latent["name"], latent["value"], *latent["ci95"], latent["identifiable"]]
                table.writerow([item["real"]["damping"], item["seed"], *row])
    hosts = {ran.machine.host for ran in result.ran if ran}
    seconds = sum(ran.seconds for ran in result.ran if ran)
    summary = f"{len(result)} estimations, {seconds:.0f} s of computation on {len(hosts)} machines: {arguments.out}"
    print(summary, file=sys.stderr)


if __name__ == "__main__":
    main()
