"""Converts measured trials (files, frames, arrays) to the CSV text that the server reads."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike

#: A file, frame or array; a sequence of these, one for each trial; or a mapping of these by the trial's name.
TrialsLike: TypeAlias = Union[str, "os.PathLike[str]", ArrayLike, Sequence[Any], Mapping[str, Any], Any]


def trial_texts(trials: TrialsLike) -> str | dict[str, str]:
    """The trials as one text, or as texts by name. `trials` may be

    - the text of a file (any string with a line break), or a path;
    - a pandas frame: its columns, and its index if it has a name;
    - an array of shape (n, 3): t (s), x, y (m); NaN for missing values;
    - a sequence of these, or a mapping by name.
    """
    if isinstance(trials, Mapping):
        return {str(name): _text(trial, f"trials[{name!r}]") for name, trial in trials.items()}
    if isinstance(trials, np.ndarray) and trials.ndim == 3:
        trials = list(trials)
    if isinstance(trials, (list, tuple)):
        if not trials:
            raise ValueError("trials is empty; allowed: at least one trial")
        paths = [_path(trial) for trial in trials]
        names = [path.stem for path in paths if path is not None]
        width = len(str(len(trials)))
        if len(set(names)) != len(trials):
            names = [f"{i + 1:0{width}d}" for i in range(len(trials))]
        return {name: _text(trial, f"trials[{i}]") for i, (name, trial) in enumerate(zip(names, trials))}
    return _text(trials, "trials")


def _path(trial: Any) -> Path | None:
    """The trial as a path, if it is one."""
    if isinstance(trial, os.PathLike):
        return Path(trial)
    return Path(trial) if isinstance(trial, str) and "\n" not in trial else None


def _text(trial: Any, field: str) -> str:
    path = _path(trial)
    if path is not None:
        return _decoded(path.read_bytes(), path)
    if isinstance(trial, str):
        return trial
    if hasattr(trial, "to_csv"):
        has_index_name = any(name is not None for name in trial.index.names)
        return str(trial.to_csv(index=has_index_name))
    table = np.asarray(trial, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 3:
        raise ValueError(f"{field} has shape {table.shape}; allowed: (n, 3), of t (s), x and y (m)")
    return "t,x,y\n" + "".join(",".join(map(_cell, row)) + "\n" for row in table.tolist())


def _decoded(data: bytes, path: Path) -> str:
    """The text of a file in UTF-8, UTF-16 or Latin-1, which programs on Windows write."""
    if data.startswith(b"\x89HDF"):
        raise ValueError(f"{path} is HDF5; allowed: a table as text, by DataFrame.to_csv, or the data frame itself")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)
