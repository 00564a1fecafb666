"""Measured trials in the forms that people have them in, as the texts that the server reads."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike

#: One file, frame or array; a sequence of them, a trial each; or a mapping of them by the trial's name.
Measured: TypeAlias = Union[str, "os.PathLike[str]", ArrayLike, Sequence[Any], Mapping[str, Any], Any]


def texts(trials: Measured) -> str | dict[str, str]:
    """One text, or texts by name.

    - text of a file (anything with a line end), or the path of one;
    - a pandas frame: its columns as they are called, with its index if that has a name;
    - an array of shape (n, 3): t (s), x, y (m); NaN where missing;
    - several of these: a sequence, or a mapping by name.
    """
    if isinstance(trials, Mapping):
        return {str(name): _text(one, f"trials[{name!r}]") for name, one in trials.items()}
    if isinstance(trials, np.ndarray) and trials.ndim == 3:
        trials = list(trials)
    if isinstance(trials, (list, tuple)):
        if not trials:
            raise ValueError("trials is empty; allowed: at least one")
        paths = [_path(one) for one in trials]
        names = [path.stem for path in paths if path is not None]
        width = len(str(len(trials)))
        if len(set(names)) != len(trials):
            names = [f"{i + 1:0{width}d}" for i in range(len(trials))]
        return {name: _text(one, f"trials[{i}]") for i, (name, one) in enumerate(zip(names, trials))}
    return _text(trials, "trials")


def _path(trial: Any) -> Path | None:
    """The path that a trial is, if it is one."""
    if isinstance(trial, os.PathLike):
        return Path(trial)
    return Path(trial) if isinstance(trial, str) and "\n" not in trial else None


def _text(trial: Any, field: str) -> str:
    path = _path(trial)
    if path is not None:
        return path.read_text(encoding="utf-8-sig")
    if isinstance(trial, str):
        return trial
    if hasattr(trial, "to_csv"):
        named = any(name is not None for name in trial.index.names)
        return str(trial.to_csv(index=named))
    table = np.asarray(trial, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 3:
        raise ValueError(f"{field} has shape {table.shape}; allowed: (n, 3), of t (s), x and y (m)")
    return "t,x,y\n" + "".join(",".join(map(_cell, row)) + "\n" for row in table.tolist())


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
