"""Which latents the outcome of an action depends on, and whether a solution of the simulation holds in the real world.

    pip install numpy && python examples/python/level_latents.py src/task/families/levels/*.toml

For each family (`iplw.family/1`, with its certified tasks in the same folder) outcome tables are computed (`iplw outcomes`) with
each latent at its prior mean minus and plus one standard deviation, and all other values those of the file's real world. A latent's
column is the share, among actions that solve at either value, of those that solve at one value only; in brackets, the share of all
valid actions whose outcome changes. `+0.1 %` compares the real world with one whose three latents are 0.1 % larger, the sensitivity
to rounding. `transfer`: the share, among actions that solve in a simulation with the prior means and no damping, of those that
solve in the real world. `mostly fail`: tasks where fewer than half of them do, of the tasks where any action solves.

Python 3.11 or later, for `tomllib`.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import sys
import tempfile
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LATENTS = ("density", "friction", "restitution")
BOUNDS = {"density": (1e-3, 1e3), "friction": (0.0, 10.0), "restitution": (0.0, 1.0)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("families", nargs="+", type=Path, help="family files")
    parser.add_argument("--actions", type=int, default=300, help="actions per task")
    parser.add_argument("--split", default="", help="train, validation or test; default: all tasks")
    parser.add_argument("--bin", default="iplw", help="the program")
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    head = ["level", "solve %", *(f"{name} %" for name in LATENTS), "+0.1 %", "transfer %", "mostly fail"]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for file in arguments.families:
        print("| " + " | ".join([file.stem, *table_row(file, arguments)]) + " |", flush=True)


def table_row(file: Path, arguments: argparse.Namespace) -> list[str]:
    """The cells of a family's table row."""
    family: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
    real, prior = dict(family["real"]), family["prior"]
    damping = real.pop("damping")

    def outcomes(damping: float, **latents: float) -> NDArray[np.int8]:
        return outcome_table(file, damping, real | latents, arguments)

    def at_bounds(name: str) -> list[NDArray[np.int8]]:
        (mean, sd), (least, most) = prior[name], BOUNDS[name]
        return [outcomes(damping, **{name: min(max(v, least), most)}) for v in (mean - sd, mean + sd)]

    truth = outcomes(damping)
    cells = [f"{100 * np.sum(truth == 1) / np.sum(truth != 0):.1f}"]
    for name in LATENTS:
        cells.append("{:.0f} ({:.1f})".format(*changed(*at_bounds(name))))
    perturbed = outcomes(damping, **{name: 1.001 * value for name, value in real.items()})
    cells.append(f"{changed(truth, perturbed)[0]:.0f}")
    simulated = outcomes(1.0, **{name: prior[name][0] for name in LATENTS}) == 1
    solving = simulated.sum(axis=1)
    both = (simulated & (truth == 1)).sum(axis=1)
    mostly_fail = np.sum((2 * both < solving) & (solving > 0))
    return [*cells, f"{100 * both.sum() / max(solving.sum(), 1):.0f}", f"{mostly_fail} of {np.sum(solving > 0)}"]


def changed(low: NDArray[np.int8], high: NDArray[np.int8]) -> tuple[float, float]:
    """Percentage of actions whose outcome differs: among those that solve in either table, and among all valid ones."""
    differ = np.sum(low != high)
    return float(100 * differ / max(np.sum((low == 1) | (high == 1)), 1)), float(100 * differ / np.sum(low != 0))


def outcome_table(file: Path, damping: float, latents: dict[str, float], arguments: argparse.Namespace) -> NDArray[np.int8]:
    """(tasks, actions) outcomes: 1 solved, -1 not solved, 0 invalid placement."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "outcomes")
        argv = [arguments.bin, "outcomes", "--task", file.stem, "--actions", str(arguments.actions), "--out", str(out)]
        argv += ["--latents", ",".join(f"{name}={value!r}" for name, value in latents.items())]
        argv += ["--threads", str(arguments.threads)]
        if damping < 1:
            argv += ["--effect", f"linear_drag:c={-math.log(damping)!r}"]
        if arguments.split:
            argv += ["--split", arguments.split]
        if not built_in(file.stem, arguments.bin):
            # A separate folder: other families in the same folder may not be certified yet.
            families = Path(folder, "families")
            families.mkdir()
            for path in (file, file.with_name(f"{file.stem}.certified.json")):
                shutil.copy(path, families)
            argv += ["--tasks", str(families)]
        done = subprocess.run(argv, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(argv)}\n{done.stderr}")
        result: NDArray[np.int8] = np.load(out / "outcomes.npy")
        return result


@cache
def built_in(name: str, program: str) -> bool:
    """Whether the family is built into the program."""
    return subprocess.run([program, "tasks", name, "--json"], capture_output=True).returncode == 0


if __name__ == "__main__":
    main()
