"""Ranked actions of a policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Ranked:
    """An action with its score."""

    #: Index of the discrete action.
    index: int
    #: (dimension,) the action vector, in [0, 1].
    action: NDArray[np.float64]
    #: Higher is better.
    score: float


def read_ranking(answer: Mapping[str, Any]) -> list[Ranked]:
    """Parses the ranked actions of a response."""
    return [
        Ranked(int(a["index"]), np.asarray(a["action"], dtype=np.float64), float(a["score"]))
        for a in answer["actions"]
    ]
