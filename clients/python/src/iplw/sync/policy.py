# Made by `generate.py` from `aio/policy.py`; change that.
"""A trained policy on the server: what it would do, how good it is, its weights."""

from __future__ import annotations

from pathlib import Path

from .. import calls
from ..call import given
from ..ranked import Ranked
from .handle import Handle
from .job import Job
from .world import World


class Policy(Handle):
    """A handle on one policy."""

    _look = "get_policy"

    def act(self, task: str, count: int = 10) -> list[Ranked]:
        """The policy's `count` best actions on a task, best first."""
        return self._line.do(calls.act(self.id, task, count))

    def evaluate(
        self, world: World | str, *, split: str = "test", attempts: int = 100
    ) -> Job:
        """AUCCESS on a world's tasks, as a job: `auccess` in [0, 1] of up to `attempts` (1 to 100) valid ones a task.

        Attempts on a real world are interactions.
        """
        answer = self._line.do(calls.evaluate(self.id, calls.id_of(world), split, attempts))
        return Job(self._line, answer)

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
            world=calls.id_of(world),
            attempts=attempts,
            batches=batches,
            batch_size=batch_size,
            learning_rate=learning_rate,
            seed=seed,
        )
        return Job(self._line, self._line.do(calls.post("learn_policy", body, key)))

    def download(self, file: str | Path | None = None) -> bytes:
        """The weights as safetensors bytes; also written to `file`, if given."""
        weights = self._line.do(calls.weights(self.id))
        if file is not None:
            Path(file).write_bytes(weights)
        return weights

    def delete(self) -> None:
        """Removes the policy from the server."""
        self._line.do(calls.get("delete_policy", self.id))
