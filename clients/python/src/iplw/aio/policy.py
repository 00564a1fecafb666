"""A trained policy on the server."""

from __future__ import annotations

from pathlib import Path

from .. import requests
from ..request import drop_none
from ..ranking import Ranked
from .resource import AsyncResource
from .job import AsyncJob
from .world import AsyncWorld


class AsyncPolicy(AsyncResource):
    """A policy."""

    _get_operation = "get_policy"

    async def act(self, task: str, count: int = 10) -> list[Ranked]:
        """The `count` highest-ranked actions on a task, best first."""
        return await self._connection.do(requests.act(self.id, task, count))

    async def evaluate(
        self, world: AsyncWorld | str, *, split: str = "test", attempts: int = 100
    ) -> AsyncJob:
        """Evaluates AUCCESS on the tasks of a world, as a job: `auccess` in [0, 1] from up to `attempts` (1 to 100) valid
        attempts for each task.

        Attempts in a real world are interactions.
        """
        answer = await self._connection.do(requests.evaluate(self.id, requests.id_of(world), split, attempts))
        return AsyncJob(self._connection, answer)

    async def learn(
        self,
        world: AsyncWorld | str,
        *,
        attempts: int | None = None,
        batches: int | None = None,
        batch_size: int | None = None,
        learning_rate: float | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Continues training in a world, as a job whose result names the new policy; its attempts are counted."""
        body = drop_none(
            id=self.id,
            world=requests.id_of(world),
            attempts=attempts,
            batches=batches,
            batch_size=batch_size,
            learning_rate=learning_rate,
            seed=seed,
        )
        return AsyncJob(self._connection, await self._connection.do(requests.post("learn_policy", body, key)))

    async def download(self, file: str | Path | None = None) -> bytes:
        """The weights as safetensors bytes; also written to `file`, if given."""
        weights = await self._connection.do(requests.weights(self.id))
        if file is not None:
            Path(file).write_bytes(weights)
        return weights

    async def delete(self) -> None:
        """Deletes the policy from the server."""
        await self._connection.do(requests.get("delete_policy", self.id))
