"""A branch of a rollout: a moment in it, something else done there, and on."""

from __future__ import annotations

from typing import Any

from typing_extensions import Self

from .. import calls
from ..branching import Changes, states
from ..rollout import Rollout
from ..scene import Scene
from .line import AsyncLine


class AsyncBranch(Changes):
    """A moment in a rollout of a simulated world, from which to go on with something else done.

    Changes add up until the end of the `with`; `rollout()` carries them out and may be asked again after more of them.
    """

    def __init__(self, line: AsyncLine, world: str, answer: dict[str, Any], scene: Scene | None) -> None:
        super().__init__()
        self._line = line
        self._world = world
        self._scene = scene
        #: The `iplw.snapshot/1` document: JSON, to be kept as long as the world.
        self.snapshot: dict[str, Any] = answer["snapshot"]
        #: s since the start of the rollout.
        self.at = float(answer["at"])
        #: name -> state at that moment.
        self.bodies = states(answer)

    async def rollout(self) -> Rollout:
        """The rollout with the changes, from its start; without any it is the uninterrupted one, to the bit."""
        rollout = await self._line.do(calls.branch(self._world, self.snapshot, self.changes))
        return calls.placed(rollout, self.snapshot, self.changes, self._scene)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.clear()

    def __repr__(self) -> str:
        return f"<iplw.{type(self).__name__} of {self._world} at {self.at:.4g} s, {len(self.changes)} changes>"
