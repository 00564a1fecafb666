"""A training on the server in TensorBoard, by a callback over `Job.follow()`, and in Weights & Biases where it is installed.

W&B runs offline unless WANDB_MODE says otherwise. Prints the first and last value of each curve.

    pip install iplw tensorboard torch && python examples/python/log_training.py && tensorboard --logdir runs
"""

from __future__ import annotations

import argparse
import importlib.util
import os
from typing import Any

from torch.utils.tensorboard import SummaryWriter

import iplw


def log(job: iplw.Job, writer: SummaryWriter, run: Any = None) -> dict[str, list[float]]:
    """Writes the figures of each event (the loss of each batch, AUCCESS at each validation) until the job ends."""
    curves: dict[str, list[float]] = {}
    for data in job.follow():
        for figure in (data.get("progress") or {}).get("figures") or []:
            name, step, value = figure["name"], int(figure["at"]), float(figure["value"])
            curves.setdefault(name, []).append(value)
            writer.add_scalar(f"train/{name}", value, step)
            if run is not None:
                run.log({"batch": step, f"train/{name}": value})
    return curves


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--batches", type=int, default=200)
    parser.add_argument("--logs", default="runs", help="directory of the event files")
    options = parser.parse_args()
    settings = {"task": "basketball", "batches": options.batches, "validations": 4, "seed": 0}
    with iplw.Client() as client, SummaryWriter(options.logs) as writer:
        run = None
        if importlib.util.find_spec("wandb"):
            import wandb

            run = wandb.init(project="iplw", config=settings, dir=options.logs, mode=os.environ.get("WANDB_MODE", "offline"))
        curves = log(client.train(**settings), writer, run)
        if run is not None:
            run.finish()
    for name, values in curves.items():
        print(f"{name:12} {len(values):4} values, first {values[0]:.3f}, last {values[-1]:.3f}")


if __name__ == "__main__":
    main()
