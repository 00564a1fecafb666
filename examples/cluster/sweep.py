"""A sweep on whatever cluster RAY_ADDRESS names, or on this machine: estimations over worlds and seeds, as a table.

    pip install 'iplw[ray]' && python examples/cluster/sweep.py --seeds 4 --out sweep.csv

The same file is what `rayjob.yaml` (Kubernetes) and `slurm.sh` run. However many nodes there are, and whichever
are lost meanwhile, the table is the same to the byte.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

from iplw import cluster


def main() -> None:
    values = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    values.add_argument("--task", default="bowling")
    values.add_argument("--damping", type=float, nargs="+", default=[0.8, 0.9], help="of the hidden worlds, 1/s")
    values.add_argument("--seeds", type=int, default=4)
    values.add_argument("--rounds", type=int, default=3)
    values.add_argument("--num-cpus", type=int, default=1, help="of each estimation")
    values.add_argument("--out", type=Path, default=Path("sweep.csv"))
    arguments = values.parse_args()
    result = cluster.estimate(
        arguments.task,
        over={"real": [{"damping": damping} for damping in arguments.damping]},
        seeds=range(arguments.seeds),
        settings={"rounds": arguments.rounds},
        num_cpus=arguments.num_cpus,
        # Nodes of a cluster come and go; a unit is lost with its node.
        tries=10,
    )
    with arguments.out.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["damping", "seed", "latent", "value", "low", "high", "identifiable"])
        for item, report in zip(result.items, result, strict=True):
            for latent in report["latents"]:
                response = [latent["name"], latent["value"], *latent["ci95"], latent["identifiable"]]
                table.writerow([item["real"]["damping"], item["seed"], *response])
    hosts = {ran.machine.host for ran in result.ran if ran}
    seconds = sum(ran.seconds for ran in result.ran if ran)
    summary = f"{len(result)} estimations, {seconds:.0f} s of computing on {len(hosts)} machines: {arguments.out}"
    print(summary, file=sys.stderr)


if __name__ == "__main__":
    main()
