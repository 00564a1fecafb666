"""Proposals of an ask-and-tell estimation, and their results in wire format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .scene import Scene

#: Columns of a state: position, angle, velocity, angular velocity.
_STATE_COLUMNS = ("x", "y", "angle", "vx", "vy", "omega")
#: States of a body: (n, 2) or (n, 3) x and y, m, and angle, rad; or columns by name (`x`, `y`, `angle`, `vx`, ...), or a
#: pandas frame with these columns. NaN for missing observations.
States: TypeAlias = "ArrayLike | Mapping[str, ArrayLike]"


@dataclass(frozen=True, eq=False)
class Proposal:
    """An action to execute in the real world."""

    #: Number within the estimation, from 0.
    number: int
    #: Round, from 0.
    round: int
    #: Id of the task.
    task: str
    #: (dimension,) the action vector, in [0, 1].
    action: NDArray[np.float64]
    #: The initial state as an `iplw.scene/1` document.
    scene: Scene
    #: (n,) observation times of a simulation, s; a measurement may use others.
    observe_at: NDArray[np.float64]
    #: Whether a result was submitted.
    answered: bool
    #: Reason for the choice; `None` if the strategy gives none.
    reason: str | None = None


def proposals(answer: Mapping[str, Any]) -> list[Proposal]:
    """Parses the proposals of a response."""
    return [
        Proposal(
            number=int(p["number"]),
            round=int(answer["round"]),
            task=str(p["task"]),
            action=np.asarray(p["action"], dtype=np.float64),
            scene=Scene(p["scene"]),
            observe_at=np.asarray(p["observe_at"], dtype=np.float64),
            answered=bool(p["answered"]),
            reason=p.get("reason"),
        )
        for p in answer["proposals"]
    ]


def trial(proposal: Proposal | int, t: ArrayLike, bodies: Mapping[str, States]) -> dict[str, Any]:
    """The result of one proposal in wire format."""
    return {
        "proposal": number_of(proposal),
        "t": np.asarray(t, dtype=np.float64).tolist(),
        "bodies": {name: _columns(states, name) for name, states in bodies.items()},
    }


def number_of(proposal: Proposal | int) -> int:
    """The number of a proposal."""
    return proposal.number if isinstance(proposal, Proposal) else int(proposal)


def _columns(states: States, name: str) -> dict[str, list[float | None]]:
    if hasattr(states, "columns"):
        # A pandas frame may have more columns.
        frame: Any = states
        states = {key: frame[key] for key in _STATE_COLUMNS if key in frame.columns}
    if isinstance(states, Mapping):
        columns = {key: np.asarray(values, dtype=np.float64) for key, values in states.items()}
    else:
        array = np.asarray(states, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] not in (2, 3):
            raise ValueError(
                f"states of {name} have shape {array.shape}; allowed: (n, 2) for x and y, or (n, 3) with the angle"
            )
        columns = dict(zip(("x", "y", "angle"), array.T))
    return {key: [None if np.isnan(v) else float(v) for v in values] for key, values in columns.items()}
