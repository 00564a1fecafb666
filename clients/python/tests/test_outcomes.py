"""Outcome tables: written by the command, read by NumPy and `iplw.Outcomes`."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import iplw
from iplw.binary import find_binary

COMMAND = ["outcomes", "--task", "basketball", "--actions", "400", "--effect", "linear_drag:c=0.223"]
TASKS, ACTIONS = 25, 400


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("outcomes")
    response = run(out).stdout
    assert "25 tasks, 400 actions each" in response
    return out


def run(out: Path, *extra: str) -> subprocess.CompletedProcess[str]:
    argv = [str(find_binary()), *COMMAND, "--out", str(out), *extra]
    return subprocess.run(argv, capture_output=True, text=True, check=False)


def test_outcome_table(folder: Path) -> None:
    table = iplw.Outcomes(folder)
    assert table.actions.shape == (400, 4) and 0 <= table.actions.min() <= table.actions.max() <= 1
    assert table.outcomes.shape == (TASKS, ACTIONS) and table.outcomes.dtype == np.int8
    assert set(np.unique(table.outcomes)) == {-1, 0, 1}
    parts = [table.of(split) for split in ("train", "validation", "test")]
    assert sorted(sum(parts, [])) == table.tasks and all(parts)
    assert table.about["effects"][0]["name"] == "linear_drag"


def test_evaluates_ranking(folder: Path) -> None:
    table = iplw.Outcomes(folder)
    knowing = table.evaluate(lambda task, _: table.row(task), table.tasks)
    solvable = [task for task in table.tasks if (table.row(task) == 1).any()]
    assert knowing.auccess == pytest.approx(len(solvable) / len(table.tasks))
    contrary = table.evaluate(lambda task, _: -table.row(task), solvable)
    assert contrary.auccess < 0.2
    odd = table.evaluate(lambda task, _: np.where(table.row(task) == 1, 1.0, np.nan), solvable)
    assert odd.auccess == 1.0
    with pytest.raises(ValueError, match=r"scores of basketball:\d+ have shape \(3,\); allowed: \(400,\)"):
        table.evaluate(lambda *_: np.zeros(3))
    with pytest.raises(KeyError, match="bowling:000"):
        table.row("bowling:000")


def test_resumes_interrupted_table(folder: Path, tmp_path: Path) -> None:
    full = (folder / "outcomes.npy").read_bytes()
    # The state after a kill during the eighth task.
    for name in ("outcomes.json", "actions.npy"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    data = full[-TASKS * ACTIONS :]
    (tmp_path / "outcomes.part").write_bytes(data[: 7 * ACTIONS + 123])
    with pytest.raises(FileNotFoundError, match="incomplete table"):
        iplw.Outcomes(tmp_path)
    done = run(tmp_path)
    assert done.returncode == 0 and "resumes after 7 tasks" in done.stderr, done.stderr
    assert (tmp_path / "outcomes.npy").read_bytes() == full
    assert not (tmp_path / "outcomes.part").exists()
    again = run(tmp_path)
    assert again.returncode == 0 and "the table is complete" in again.stderr and again.stdout == done.stdout
    other = run(tmp_path, "--seed", "1")
    assert other.returncode == 2 and "another directory" in other.stderr
    assert json.loads((tmp_path / "outcomes.json").read_text())["seed"] == 0
    assert (tmp_path / "outcomes.npy").read_bytes() == full


@pytest.mark.parametrize("leftover", ["outcomes.part", "outcomes.npy", "outcomes.json", "actions.npy"])
def test_rejects_directory_of_another_table(folder: Path, tmp_path: Path, leftover: str) -> None:
    (tmp_path / leftover).write_bytes(b"mine")
    if leftover == "outcomes.part":
        about = json.loads((folder / "outcomes.json").read_text())
        (tmp_path / "outcomes.json").write_text(json.dumps(about | {"seed": 1}))
    error = run(tmp_path)
    assert error.returncode == 2 and "another directory" in error.stderr, error.stderr
    assert (tmp_path / leftover).read_bytes() == b"mine"
    assert len(list(tmp_path.iterdir())) == (2 if leftover == "outcomes.part" else 1)
