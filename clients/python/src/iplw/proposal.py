"""What an estimation wants carried out, and what came of it as the wire has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .scene import Scene

#: Columns of a state.
_COLUMNS = ("x", "y", "angle", "vx", "vy", "omega")
#: States of a body: (n, 2) or (n, 3) x and y, m, and angle, rad; or columns by name (`x`, `y`, `angle`, `vx`, ...), as
#: a pandas frame has them, too. NaN where it was not seen.
States: TypeAlias = "ArrayLike | Mapping[str, ArrayLike]"


@dataclass(frozen=True, eq=False)
class Proposal:
    """An action to carry out on the real world."""

    #: Counts from 0 over the whole estimation.
    number: int
    #: The round it belongs to, from 0.
    round: int
    #: Id of the task.
    task: str
    #: (dimension,) the action vector, in [0, 1].
    action: NDArray[np.float64]
    #: An `iplw.scene/1` document: everything placed as it is to be let go.
    scene: Scene
    #: (n,) times that a simulation is observed at, s; a measurement may take others.
    observe_at: NDArray[np.float64]
    #: Whether it was told of already.
    answered: bool
    #: Why it was chosen, in words; `None` where the strategy gives no reasons.
    reason: str | None = None


def proposals(answer: Mapping[str, Any]) -> list[Proposal]:
    """The proposals of an answer."""
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
    """What one proposal brought, as the wire has it."""
    return {
        "proposal": number_of(proposal),
        "t": np.asarray(t, dtype=np.float64).tolist(),
        "bodies": {name: _columns(states, name) for name, states in bodies.items()},
    }


def number_of(proposal: Proposal | int) -> int:
    """A proposal's number."""
    return proposal.number if isinstance(proposal, Proposal) else int(proposal)


def _columns(states: States, name: str) -> dict[str, list[float | None]]:
    if hasattr(states, "columns"):
        # A pandas frame may have more columns.
        frame: Any = states
        states = {key: frame[key] for key in _COLUMNS if key in frame.columns}
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
