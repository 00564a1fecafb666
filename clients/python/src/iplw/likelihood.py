"""How likely measured trials are at points: arrays as calls have them, and answers as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .call import Call, given

#: Points that are asked for in a request.
TOGETHER = 512
#: Seconds granted for each of them, beyond the client's timeout.
SLACK = 0.05


def checked(points: ArrayLike, names: Sequence[str]) -> NDArray[np.float64]:
    """Points as an array (n, d) or, of a single one, (d,); `ValueError` unless d is the number of names."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim not in (1, 2) or array.shape[-1] != len(names):
        d = len(names)
        raise ValueError(f"points has shape {array.shape}; allowed: (n, {d}) or ({d},), of {', '.join(names)}")
    return array


def asked(
    id: str, names: Sequence[str], points: NDArray[np.float64], prior_only: bool
) -> list[Call[NDArray[np.float64]]]:
    """Log prior and log likelihood (n, 2) of finite points (n, d), some at a time."""

    def part(points: NDArray[np.float64]) -> Call[NDArray[np.float64]]:
        columns = {name: points[:, k] for k, name in enumerate(names)}
        args = {"id": id, "columns": columns, **given(prior_only=prior_only or None)}
        return Call("evaluate_likelihood", args, _densities, slack=SLACK * len(points), raw=True)

    return [part(points[start : start + TOGETHER]) for start in range(0, len(points), TOGETHER)]


def starts(id: str, names: Sequence[str], count: int, seed: int | None) -> Call[NDArray[np.float64]]:
    """Points (n, d) at which chains may begin."""

    def read(answer: Mapping[str, Any]) -> NDArray[np.float64]:
        return np.stack([np.asarray(answer["columns"][name], dtype=np.float64) for name in names], axis=1)

    return Call("draw_starts", {"id": id, "count": count, **given(seed=seed)}, read, slack=SLACK * count)


def plain(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values by point; of a single point a number."""
    number: NDArray[np.float64] = values[()]
    return number


def _densities(answer: Mapping[str, Any]) -> NDArray[np.float64]:
    prior = _numbers(answer["log_prior"])
    likelihood = answer.get("log_likelihood")
    return np.stack([prior, np.full_like(prior, np.nan) if likelihood is None else _numbers(likelihood)], axis=1)


def _numbers(column: Any) -> NDArray[np.float64]:
    # JSON has no infinity.
    if isinstance(column, list):
        column = [-np.inf if value is None else value for value in column]
    return np.asarray(column, dtype=np.float64)
