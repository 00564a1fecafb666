"""A branch of a rollout: continues from a snapshot with interventions."""

from __future__ import annotations

from typing import Any

from typing_extensions import Self

from .. import requests
from ..branching import Changes, states
from ..rollout import Rollout
from ..scene import Scene
from .connection import AsyncConnection


class AsyncBranch(Changes):
    """A snapshot of a rollout in a simulated world, from which to continue with interventions.

    Interventions accumulate until the end of the `with` block; `rollout()` applies them and may be called repeatedly.
    """

    def __init__(self, line: AsyncConnection, world: str, answer: dict[str, Any], scene: Scene | None) -> None:
        super().__init__()
        self._connection = line
        self._world = world
        self._scene = scene
        #: The `iplw.snapshot/1` document, a JSON value; valid as long as the world exists.
        self.snapshot: dict[str, Any] = answer["snapshot"]
        #: Time since the start of the rollout, s.
        self.at = float(answer["at"])
        #: name -> state at that time.
        self.bodies = states(answer)

    async def rollout(self) -> Rollout:
        """The rollout with the interventions, from its start; without any it is bit-identical to the original."""
        rollout = await self._connection.do(requests.branch(self._world, self.snapshot, self.changes))
        return requests.with_branch_context(rollout, self.snapshot, self.changes, self._scene)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.clear()

    def __repr__(self) -> str:
        return f"<iplw.{type(self).__name__} of {self._world} at {self.at:.4g} s, {len(self.changes)} changes>"
