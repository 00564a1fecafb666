"""The examples run, from a checkout."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "python"


def test_train_outside() -> None:
    pytest.importorskip("sklearn")
    small = ["--tasks", "8", "--actions", "25", "--tests", "2", "--rounds", "1"]
    run = subprocess.run(
        [sys.executable, EXAMPLES / "train_outside.py", *small], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    rows = {line.split()[0]: line.split()[1:] for line in run.stdout.splitlines() if line}
    for ranking in ("random", "default", "estimated"):
        assert 0.0 <= float(rows[ranking][0]) <= 1.0
        assert int(rows[ranking][-1]) > 0, "real attempts are counted"


def test_train_network() -> None:
    small = ["--worlds", "64", "--steps", "80"]
    run = subprocess.run(
        [sys.executable, EXAMPLES / "train_network.py", *small],
        capture_output=True,
        text=True,
        check=False,
        # Small matrices do not benefit from threads.
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert run.returncode == 0, run.stderr
    rows = {line[:14].strip(): line[14:].split() for line in run.stdout.splitlines() if line}
    trained, chance = (float(rows[policy][0]) for policy in ("this network", "random"))
    # 0.85 versus 0.43 in the real world; an untrained network ranks at random.
    assert trained > chance + 0.2, run.stdout
    assert int(rows["this network"][-1]) > 0, "real attempts are counted"
    shares = [float(line.split("solved")[1].split("%")[0]) for line in run.stdout.splitlines() if "solved" in line]
    assert shares[-1] > 2 * shares[0], "performance increases during training"


def test_robot() -> None:
    pytest.importorskip("pymunk")
    small = ["--rounds", "2", "--actions", "5", "--samples", "60"]
    run = subprocess.run(
        [sys.executable, EXAMPLES / "robot.py", *small], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    rows = {line.split()[0]: line.split()[1:] for line in run.stdout.splitlines() if line}
    assert "10 interactions" in run.stdout
    for latent in ("friction", "restitution"):
        truth, estimate = map(float, rows[latent][:2])
        # The prior sd is 0.25 or more. The other engine and air drag, which the model lacks, add errors.
        assert abs(estimate - truth) < 0.06, run.stdout


def test_many_processes() -> None:
    pytest.importorskip("joblib")
    small = ["--task", "basketball", "--seeds", "3", "--rounds", "1", "--jobs", "2"]
    run = subprocess.run(
        [sys.executable, EXAMPLES / "many_processes.py", *small], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert [line.split()[:2] for line in run.stdout.splitlines()] == [["seed", str(seed)] for seed in range(3)]
