"""Tables of what actions do in tasks, as `iplw outcomes` writes them: to learn and be judged without a simulator."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .results import Score, weighted

#: The action solves the task; it does not; it cannot be placed.
SOLVED, UNSOLVED, INVALID = 1, -1, 0
#: Most attempts that count.
ATTEMPTS = 100
FORMAT = "iplw.outcomes/1"


class Outcomes:
    """The table in a directory that `iplw outcomes --out` wrote.

        table = iplw.Outcomes("outcomes")
        row = table.row("bowling:003")                    # (actions,) int8: 1 solved, -1 not, 0 cannot be placed
        score = table.evaluate(lambda task, actions: model(task, actions))
        score.auccess

    `actions` is (actions, components) float64, each in [0, 1]; `outcomes` is (tasks, actions) int8, read from the file
    as it is asked for.
    """

    def __init__(self, directory: str | Path) -> None:
        folder = Path(directory)
        about = folder / "outcomes.json"
        if not about.is_file():
            raise FileNotFoundError(f"{about} is not there: write a table with `iplw outcomes --out {folder}`")
        self.about: dict[str, Any] = json.loads(about.read_text(encoding="utf-8"))
        if self.about.get("format") != FORMAT:
            raise ValueError(f"{about}: format is {self.about.get('format')!r}; allowed: {FORMAT!r}")
        if not (folder / "outcomes.npy").is_file():
            raise FileNotFoundError(f"{folder} holds a table that is not finished: begin that `iplw outcomes` again")
        self.actions: NDArray[np.float64] = np.load(folder / "actions.npy")
        self.outcomes: NDArray[np.int8] = np.load(folder / "outcomes.npy", mmap_mode="r")
        self.tasks: list[str] = [task["id"] for task in self.about["tasks"]]
        self.splits: dict[str, str] = {task["id"]: task["split"] for task in self.about["tasks"]}

    def __repr__(self) -> str:
        return f"<Outcomes of {self.about['family']}: {len(self.tasks)} tasks, {len(self.actions)} actions>"

    def of(self, split: str) -> list[str]:
        """Names of the tasks of `train`, `validation` or `test`."""
        if split not in ("train", "validation", "test"):
            raise ValueError(f"split is {split!r}; allowed: 'train', 'validation', 'test'")
        return [task for task in self.tasks if self.splits[task] == split]

    def row(self, task: str) -> NDArray[np.int8]:
        """(actions,) what each action does in a task."""
        if task not in self.splits:
            raise KeyError(f"task {task!r} is not in the table; it has {self.tasks[0]} to {self.tasks[-1]}")
        row: NDArray[np.int8] = self.outcomes[self.tasks.index(task)]
        return row

    def evaluate(
        self, scorer: Callable[[str, NDArray[np.float64]], ArrayLike], tasks: Iterable[str] | None = None
    ) -> Score:
        """AUCCESS of a ranking: valid actions are tried from the highest score down, up to 100 a task.

        `scorer(task, actions)` takes a task's name and the (actions, components) actions and returns (actions,) scores.
        Equal scores keep the table's order; what is not a number comes last. `tasks`: the test tasks if not given.
        """
        chosen = list(self.of("test") if tasks is None else tasks)
        if not chosen:
            raise ValueError("tasks is empty; allowed: names of tasks of the table")
        solved_at = [self._solved_at(task, scorer(task, self.actions)) for task in chosen]
        first = np.array([np.inf if at is None else at for at in solved_at])
        curve = (first[:, None] <= np.arange(1, ATTEMPTS + 1)).mean(axis=0)
        return Score(
            auccess=weighted(curve),
            solved_within=curve.tolist(),
            tasks=[{"task": task, "solved_at": at} for task, at in zip(chosen, solved_at, strict=True)],
        )

    def _solved_at(self, task: str, scores: ArrayLike) -> int | None:
        given, row = np.asarray(scores, dtype=np.float64), self.row(task)
        if given.shape != row.shape:
            raise ValueError(f"scores of {task} have shape {given.shape}; allowed: {row.shape}, one an action")
        order = np.argsort(np.where(np.isnan(given), np.inf, -given), kind="stable")
        tried = row[order]
        tried = tried[tried != INVALID][:ATTEMPTS]
        solving = np.flatnonzero(tried == SOLVED)
        return int(solving[0]) + 1 if len(solving) else None
