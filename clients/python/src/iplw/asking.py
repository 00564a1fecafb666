"""Ask and tell: an estimation whose real world is yours. It proposes, you carry out and tell what you measured."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import calls
from .job import Job
from .operations import given

#: Time between two looks for proposals, s.
POLL = 0.2

#: States of a body: (n, 2) or (n, 3) x and y, m, and angle, rad; or columns by name (`x`, `y`, `angle`, `vx`, ...).
#: NaN where it was not seen.
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
    scene: dict[str, Any]
    #: (n,) times that a simulation is observed at, s; a measurement may take others.
    observe_at: NDArray[np.float64]
    #: Whether it was told of already.
    answered: bool


class Asking(Job):
    """An estimation that asks: `client.iplw(task, real="ask_tell")`.

    while proposals := job.proposals():
        for proposal in proposals:
            job.tell(proposal, *measure(proposal.scene))
    result = job.wait()

    What was told is kept by the server over restarts of either side; `client.job(id)` goes on with it. A lost
    connection while telling is made up for, and the same answer told twice is one.
    """

    def proposals(self, *, all: bool = False, timeout: float | None = None) -> list[Proposal]:
        """What is to be carried out now; waits for the server to think. Empty once the job has ended.

        Those told of already are left out unless `all`. After `timeout` seconds, `TimeoutError`.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            asked = self._transport.do(calls.proposals(self.id))
            if asked["state"] != self.state:
                self.refresh()
            found = [_proposal(p, int(asked["round"])) for p in asked["proposals"]]
            wanted = [p for p in found if all or not p.answered]
            if wanted or self.ended:
                return wanted
            if deadline is not None and time.monotonic() > deadline:
                raise TimeoutError(f"job {self.id} has not proposed anything in time; ask again")
            time.sleep(POLL)

    def tell(
        self, proposal: Proposal | int, t: ArrayLike, bodies: Mapping[str, States], *, replace: bool = False
    ) -> dict[str, Any]:
        """Tells what one proposal brought: times from 0 s on, and each body's states at them.

        Returns where the round stands. Another answer than one told before needs `replace`.
        """
        number = proposal.number if isinstance(proposal, Proposal) else int(proposal)
        trial = {
            "proposal": number,
            "t": np.asarray(t, dtype=np.float64).tolist(),
            "bodies": {name: _columns(states, name) for name, states in bodies.items()},
        }
        return self._tell({"trials": [trial], **given(replace=replace or None)})

    def fail(self, proposals: Iterable[Proposal | int]) -> dict[str, Any]:
        """Tells that these proposals could not be carried out."""
        numbers = [p.number if isinstance(p, Proposal) else int(p) for p in proposals]
        return self._tell({"failed": numbers})

    def tell_csv(
        self, text: str, *, failed: Sequence[int] = (), close: bool = False, replace: bool = False
    ) -> dict[str, Any]:
        """Tells a trials file, `trial,t,body,x,y,...`, whose trials are named by the numbers of proposals."""
        said = given(
            csv=text,
            failed=",".join(map(str, failed)) or None,
            close="true" if close else None,
            replace="true" if replace else None,
        )
        return self._tell(said)

    def close(self, round: int) -> dict[str, Any]:
        """Ends this round with what was told of it; the rest has failed."""
        return self._tell({"round": round, "close": True})

    def _tell(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return self._transport.do(calls.tell(self.id, body, _key()))


def _key() -> str:
    return uuid.uuid4().hex


def _proposal(data: Mapping[str, Any], round: int) -> Proposal:
    return Proposal(
        number=int(data["number"]),
        round=round,
        task=str(data["task"]),
        action=np.asarray(data["action"], dtype=np.float64),
        scene=data["scene"],
        observe_at=np.asarray(data["observe_at"], dtype=np.float64),
        answered=bool(data["answered"]),
    )


def _columns(states: States, name: str) -> dict[str, list[float | None]]:
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
