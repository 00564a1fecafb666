"""The examples run, from a checkout."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "python"
#: Short examples for other packages, and the packages of each; `make examples-extra` installs them.
SHORT = {
    "tune_optuna": ["optuna"],
    "infer_sbi": ["sbi", "torch"],
    "plot_arviz": ["arviz"],
    "log_training": ["tensorboard", "torch"],
    "train_ppo_attempts": ["stable_baselines3"],
}


def run_short(name: str, folder: Path) -> str:
    """What the example prints in this working directory; skips if a package is missing."""
    if missing := [package for package in SHORT[name] if importlib.util.find_spec(package) is None]:
        pytest.skip(f"not installed: {', '.join(missing)}; `make examples-extra` runs {name}.py")
    run = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "WANDB_MODE": "offline", "MPLBACKEND": "agg"},
    )
    assert run.returncode == 0, run.stderr
    print(f"\n{name}.py\n{run.stdout.strip()}")
    return run.stdout


@pytest.mark.parametrize("name", SHORT)
def test_short_examples_are_short(name: str) -> None:
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    head = text.split('"""')[1]
    assert f"pip install iplw {SHORT[name][0].replace('_', '-')}" in head.replace("'", "") and f"python examples/python/{name}.py" in head


def test_tune_optuna(tmp_path: Path) -> None:
    rows = {line[:12].strip(): line[12:].split() for line in run_short("tune_optuna", tmp_path).splitlines()}
    for latent in ("friction", "restitution"):
        truth, optuna, iplw = map(float, rows[latent])
        assert abs(iplw - truth) < 0.005 and abs(optuna - truth) < 0.1


def test_infer_sbi(tmp_path: Path) -> None:
    for line in run_short("infer_sbi", tmp_path).splitlines()[-2:]:
        truth, mean, sd, p = map(float, re.findall(r"\d\.\d+", line))
        assert abs(mean - truth) < 4 * sd < 0.2 and p > 0.001
    assert (tmp_path / "sbc.png").stat().st_size > 5000


def test_plot_arviz(tmp_path: Path) -> None:
    rows = [line.split() for line in run_short("plot_arviz", tmp_path).splitlines()]
    for row in rows[-3:]:
        truth, mean, sd = map(float, row[1:4])
        assert abs(mean - truth) < 4 * sd and float(row[-1]) < 1.05
    assert {path.name for path in tmp_path.glob("*.png")} == {"trace.png", "pair.png", "posterior.png"}


def test_log_training(tmp_path: Path) -> None:
    rows = dict(line.split(maxsplit=1) for line in run_short("log_training", tmp_path).splitlines())
    first, last = map(float, re.findall(r"\d\.\d+", rows["loss"]))
    assert last < first / 2 and rows["loss"].startswith("200 values")
    assert list((tmp_path / "runs").glob("events.out.tfevents.*"))
    if importlib.util.find_spec("wandb") is not None:
        assert list((tmp_path / "runs" / "wandb").glob("offline-run-*/*.wandb"))


def test_train_ppo_attempts(tmp_path: Path) -> None:
    before, after = map(float, re.findall(r"\d\.\d+", run_short("train_ppo_attempts", tmp_path).splitlines()[-1]))
    assert after > before + 0.4


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
