"""Which latents the outcome of an action depends on, and whether a solution of the simulation holds in the real world.

    pip install numpy && python examples/python/level_latents.py src/task/families/levels/*.toml

For each family (`iplw.family/1`, its certified tasks beside it) tables of outcomes are made (`iplw outcomes`) with each latent at
either end of what its prior holds likely, the mean less and plus one standard deviation, everything else as in the real world that
the file hides. Printed is, of the actions that solve at either end, the share that solve at one only; in brackets the share of all
valid actions whose outcome changes. `a hair` compares the real world with one whose three latents are a thousandth larger: what
changes there is chance. `hold`: of the actions that solve in a simulation with the prior's means and no damping, the share that
solve in the real world; `most fail`: the tasks where fewer than half of them do, of those where any solves.

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
    values = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    values.add_argument("families", nargs="+", type=Path, help="families' files")
    values.add_argument("--actions", type=int, default=300, help="actions tried in each task")
    values.add_argument("--split", default="", help="train, validation or test; all tasks if not given")
    values.add_argument("--bin", default="iplw", help="the program")
    values.add_argument("--threads", type=int, default=1)
    arguments = values.parse_args()
    head = ["level", "solve %", *(f"{name} %" for name in LATENTS), "a hair %", "hold %", "most fail"]
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for file in arguments.families:
        print("| " + " | ".join([file.stem, *response(file, arguments)]) + " |", flush=True)


def response(file: Path, arguments: argparse.Namespace) -> list[str]:
    """The cells of a family's row."""
    family: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
    real, prior = dict(family["real"]), family["prior"]
    stored = real.pop("damping")

    def outcomes(damping: float, **latents: float) -> NDArray[np.int8]:
        return table(file, damping, real | latents, arguments)

    def ends(name: str) -> list[NDArray[np.int8]]:
        (mean, sd), (least, most) = prior[name], BOUNDS[name]
        return [outcomes(stored, **{name: min(max(v, least), most)}) for v in (mean - sd, mean + sd)]

    truth = outcomes(stored)
    cells = [f"{100 * np.sum(truth == 1) / np.sum(truth != 0):.1f}"]
    for name in LATENTS:
        cells.append("{:.0f} ({:.1f})".format(*changed(*ends(name))))
    hair = outcomes(stored, **{name: 1.001 * value for name, value in real.items()})
    cells.append(f"{changed(truth, hair)[0]:.0f}")
    simulated = outcomes(1.0, **{name: prior[name][0] for name in LATENTS}) == 1
    solving = simulated.sum(axis=1)
    both = (simulated & (truth == 1)).sum(axis=1)
    most_fail = np.sum((2 * both < solving) & (solving > 0))
    return [*cells, f"{100 * both.sum() / max(solving.sum(), 1):.0f}", f"{most_fail} of {np.sum(solving > 0)}"]


def changed(low: NDArray[np.int8], high: NDArray[np.int8]) -> tuple[float, float]:
    """Share of actions whose outcome differs, %: of those that solve in either table, and of all valid ones."""
    differ = np.sum(low != high)
    return float(100 * differ / max(np.sum((low == 1) | (high == 1)), 1)), float(100 * differ / np.sum(low != 0))


def table(file: Path, damping: float, latents: dict[str, float], arguments: argparse.Namespace) -> NDArray[np.int8]:
    """(tasks, actions) outcomes: 1 solved, -1 not, 0 cannot be placed."""
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
            # A folder of its own: others beside it may not be certified yet.
            alone = Path(folder, "families")
            alone.mkdir()
            for path in (file, file.with_name(f"{file.stem}.certified.json")):
                shutil.copy(path, alone)
            argv += ["--tasks", str(alone)]
        done = subprocess.run(argv, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(argv)}\n{done.stderr}")
        result: NDArray[np.int8] = np.load(out / "outcomes.npy")
        return result


@cache
def built_in(name: str, program: str) -> bool:
    """Whether the program knows the family by itself."""
    return subprocess.run([program, "tasks", name, "--json"], capture_output=True).returncode == 0


if __name__ == "__main__":
    main()
