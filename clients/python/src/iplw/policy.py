"""A trained policy on the server: what it would do, how good it is, its weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import calls
from .handle import Handle
from .job import Job
from .operations import given
from .world import World


@dataclass(frozen=True, eq=False)
class Ranked:
    """One action as a policy ranks it."""

    #: Number of the discrete action.
    index: int
    #: (dimension,) the action vector, in [0, 1].
    action: NDArray[np.float64]
    #: Higher is better.
    score: float


class Policy(Handle):
    """A handle on one policy."""

    _look = "get_policy"

    def act(self, task: str, count: int = 10) -> list[Ranked]:
        """The policy's `count` best actions on a task, best first."""
        answer = self._transport.do(calls.act(self.id, task, count))
        return ranked(answer)

    def evaluate(self, world: World | str, *, split: str = "test", attempts: int = 100) -> Job:
        """AUCCESS on a world's tasks, as a job. Attempts on a real world are interactions."""
        name = world.id if isinstance(world, World) else world
        return Job(self._transport, self._transport.do(calls.evaluate(self.id, name, split, attempts)))

    def learn(
        self,
        world: World | str,
        *,
        attempts: int | None = None,
        batches: int | None = None,
        batch_size: int | None = None,
        learning_rate: float | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> Job:
        """Learns on in a world, as a job whose result names the new policy; attempts are counted there."""
        body = given(
            id=self.id,
            world=world.id if isinstance(world, World) else world,
            attempts=attempts,
            batches=batches,
            batch_size=batch_size,
            learning_rate=learning_rate,
            seed=seed,
        )
        return Job(self._transport, self._transport.do(calls.post("learn_policy", body, key)))

    def download(self, file: str | Path | None = None) -> bytes:
        """The weights as safetensors bytes; also written to `file`, if given."""
        weights = self._transport.do(calls.weights(self.id))
        if file is not None:
            Path(file).write_bytes(weights)
        return weights

    def delete(self) -> None:
        """Removes the policy from the server."""
        self._transport.do(calls.get("delete_policy", self.id))


def ranked(answer: Mapping[str, Any]) -> list[Ranked]:
    """The actions as a policy's answer ranks them."""
    return [
        Ranked(int(a["index"]), np.asarray(a["action"], dtype=np.float64), float(a["score"]))
        for a in answer["actions"]
    ]
