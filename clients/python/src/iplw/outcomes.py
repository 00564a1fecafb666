"""Outcome tables of actions and tasks, written by `iplw outcomes`, for training and evaluation without a simulator."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .results import Score, weighted

#: Outcomes of an action in a task: solves it; does not solve it; cannot be placed.
SOLVED, UNSOLVED, INVALID = 1, -1, 0
#: Attempts for each task that count for AUCCESS.
MAX_ATTEMPTS = 100
FORMAT = "iplw.outcomes/1"


class Outcomes:
    """An outcome table in a directory written by `iplw outcomes --out`.

        table = iplw.Outcomes("outcomes")
        row = table.row("bowling:003")                    # (actions,) int8: 1 solved, -1 not solved, 0 cannot be placed
        score = table.evaluate(lambda task, actions: model(task, actions))
        score.auccess

    `actions` is (actions, components) float64, each in [0, 1]; `outcomes` is (tasks, actions) int8, memory-mapped
    from the file.
    """

    def __init__(self, directory: str | Path) -> None:
        folder = Path(directory)
        metadata_file = folder / "outcomes.json"
        if not metadata_file.is_file():
            raise FileNotFoundError(f"{metadata_file} does not exist; write a table with `iplw outcomes --out {folder}`")
        self.about: dict[str, Any] = json.loads(metadata_file.read_text(encoding="utf-8"))
        if self.about.get("format") != FORMAT:
            raise ValueError(f"{metadata_file}: format is {self.about.get('format')!r}; allowed: {FORMAT!r}")
        if not (folder / "outcomes.npy").is_file():
            raise FileNotFoundError(f"{folder} holds an incomplete table; run that `iplw outcomes` again to complete it")
        self.actions: NDArray[np.float64] = np.load(folder / "actions.npy")
        self.outcomes: NDArray[np.int8] = np.load(folder / "outcomes.npy", mmap_mode="r")
        self.tasks: list[str] = [task["id"] for task in self.about["tasks"]]
        self.splits: dict[str, str] = {task["id"]: task["split"] for task in self.about["tasks"]}

    def __repr__(self) -> str:
        return f"<Outcomes of {self.about['family']}: {len(self.tasks)} tasks, {len(self.actions)} actions>"

    def of(self, split: str) -> list[str]:
        """Ids of the tasks of the split `train`, `validation` or `test`."""
        if split not in ("train", "validation", "test"):
            raise ValueError(f"split is {split!r}; allowed: 'train', 'validation', 'test'")
        return [task for task in self.tasks if self.splits[task] == split]

    def row(self, task: str) -> NDArray[np.int8]:
        """(actions,) outcome of each action in a task."""
        if task not in self.splits:
            raise KeyError(f"task {task!r} is not in the table; it has {self.tasks[0]} to {self.tasks[-1]}")
        row: NDArray[np.int8] = self.outcomes[self.tasks.index(task)]
        return row

    def evaluate(
        self, scorer: Callable[[str, NDArray[np.float64]], ArrayLike], tasks: Iterable[str] | None = None
    ) -> Score:
        """AUCCESS of a ranking: valid actions are tried in order of decreasing score, up to 100 for each task.

        `scorer(task, actions)` takes a task's name and the (actions, components) actions and returns (actions,) scores.
        Ties keep the table's order; NaN ranks last. `tasks`: ids; default: the test tasks.
        """
        selected = list(self.of("test") if tasks is None else tasks)
        if not selected:
            raise ValueError("tasks is empty; allowed: names of tasks of the table")
        solved_at = [self._solved_at(task, scorer(task, self.actions)) for task in selected]
        first = np.array([np.inf if at is None else at for at in solved_at])
        curve = (first[:, None] <= np.arange(1, MAX_ATTEMPTS + 1)).mean(axis=0)
        return Score(
            auccess=weighted(curve),
            solved_within=curve.tolist(),
            tasks=[{"task": task, "solved_at": at} for task, at in zip(selected, solved_at, strict=True)],
        )

    def _solved_at(self, task: str, scores: ArrayLike) -> int | None:
        values, row = np.asarray(scores, dtype=np.float64), self.row(task)
        if values.shape != row.shape:
            raise ValueError(f"scores of {task} have shape {values.shape}; allowed: {row.shape}, one for each action")
        order = np.argsort(np.where(np.isnan(values), np.inf, -values), kind="stable")
        attempts = row[order]
        attempts = attempts[attempts != INVALID][:MAX_ATTEMPTS]
        solved = np.flatnonzero(attempts == SOLVED)
        return int(solved[0]) + 1 if len(solved) else None
