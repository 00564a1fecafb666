"""Actions as a policy ranks them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Ranked:
    """One action as a policy ranks it."""

    #: Number of the discrete action.
    index: int
    #: (dimension,) the action vector, in [0, 1].
    action: NDArray[np.float64]
    #: Higher is better.
    score: float


def ranked(answer: Mapping[str, Any]) -> list[Ranked]:
    """The actions as a policy's answer ranks them."""
    return [
        Ranked(int(a["index"]), np.asarray(a["action"], dtype=np.float64), float(a["score"]))
        for a in answer["actions"]
    ]
