"""Requests and responses of the likelihood service, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .request import Request, drop_none

#: Points in one request.
POINTS_PER_REQUEST = 512
#: Added to the client's timeout for each point, s.
EXTRA_S_PER_POINT = 0.05


def as_points(points: ArrayLike, names: Sequence[str]) -> NDArray[np.float64]:
    """Points as an array (n, d), or (d,) for a single point; `ValueError` unless d is the number of names."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim not in (1, 2) or array.shape[-1] != len(names):
        d = len(names)
        raise ValueError(f"points has shape {array.shape}; allowed: (n, {d}) or ({d},), of {', '.join(names)}")
    return array


def evaluation_requests(
    id: str, names: Sequence[str], points: NDArray[np.float64], prior_only: bool
) -> list[Request[NDArray[np.float64]]]:
    """Requests for log prior and log likelihood (n, 2) of finite points (n, d), in batches."""

    def batch_request(points: NDArray[np.float64]) -> Request[NDArray[np.float64]]:
        columns = {name: points[:, k] for k, name in enumerate(names)}
        args = {"id": id, "columns": columns, **drop_none(prior_only=prior_only or None)}
        return Request("evaluate_likelihood", args, _densities, extra_timeout_s=EXTRA_S_PER_POINT * len(points), raw_arrays=True)

    return [batch_request(points[start : start + POINTS_PER_REQUEST]) for start in range(0, len(points), POINTS_PER_REQUEST)]


def start_points_request(id: str, names: Sequence[str], count: int, seed: int | None) -> Request[NDArray[np.float64]]:
    """Request for initial points (n, d) of chains."""

    def read(answer: Mapping[str, Any]) -> NDArray[np.float64]:
        return np.stack([np.asarray(answer["columns"][name], dtype=np.float64) for name in names], axis=1)

    return Request("draw_starts", {"id": id, "count": count, **drop_none(seed=seed)}, read, extra_timeout_s=EXTRA_S_PER_POINT * count)


def scalar_if_single(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array, or a scalar if it is 0-dimensional."""
    number: NDArray[np.float64] = values[()]
    return number


def _densities(answer: Mapping[str, Any]) -> NDArray[np.float64]:
    prior = _numbers(answer["log_prior"])
    likelihood = answer.get("log_likelihood")
    return np.stack([prior, np.full_like(prior, np.nan) if likelihood is None else _numbers(likelihood)], axis=1)


def _numbers(column: Any) -> NDArray[np.float64]:
    # JSON has no infinity: null is minus infinity.
    if isinstance(column, list):
        column = [-np.inf if value is None else value for value in column]
    return np.asarray(column, dtype=np.float64)
