"""Ask and tell: an estimation whose real world is yours. It proposes, you carry out and tell what you measured."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from .. import calls
from ..call import given
from ..proposal import Proposal, States, number_of, proposals, trial
from .job import AsyncJob

#: Time between two looks for proposals, s.
POLL = 0.2


class AsyncAsking(AsyncJob):
    """An estimation that asks: `await client.iplw(task, real="ask_tell")`.

    while proposals := await job.proposals():
        for proposal in proposals:
            await job.tell(proposal, *measure(proposal.scene))
    result = await job.wait()

    What was told is kept by the server over restarts of either side; `await client.job(id)` goes on with it. A lost
    connection while telling is made up for, and the same answer told twice is one.
    """

    async def proposals(self, *, all: bool = False, timeout: float | None = None) -> list[Proposal]:
        """What is to be carried out now; waits for the server to think. Empty once the job has ended.

        Those told of already are left out unless `all`. After `timeout` seconds, `TimeoutError`.
        """
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        while True:
            asked = await self._line.do(calls.proposals(self.id))
            if asked["state"] != self.state:
                await self.refresh()
            wanted = [p for p in proposals(asked) if all or not p.answered]
            if wanted or self.ended:
                return wanted
            if time.monotonic() > deadline:
                raise TimeoutError(f"job {self.id} has not proposed anything in time; ask again")
            await self._line.sleep(POLL)

    async def tell(
        self, proposal: Proposal | int, t: ArrayLike, bodies: Mapping[str, States], *, replace: bool = False
    ) -> dict[str, Any]:
        """Tells what one proposal brought: times from 0 s on, and each body's states at them.

        t: (n,) s; bodies: name -> (n, 2) x and y of the centre, m, or (n, 3) with the angle, rad, or columns by name; NaN
        where it was not seen, `ValueError` for another shape. Returns where the round stands. Another answer than one told
        before needs `replace`.
        """
        return await self._tell({"trials": [trial(proposal, t, bodies)], **given(replace=replace or None)})

    async def fail(self, proposals: Iterable[Proposal | int]) -> dict[str, Any]:
        """Tells that these proposals could not be carried out."""
        return await self._tell({"failed": [number_of(p) for p in proposals]})

    async def tell_csv(
        self, text: str, *, failed: Sequence[int] = (), close: bool = False, replace: bool = False
    ) -> dict[str, Any]:
        """Tells a trials file, `trial,t,body,x,y,...`, whose trials are named by the numbers of proposals."""
        said = given(
            csv=text,
            failed=",".join(map(str, failed)) or None,
            close="true" if close else None,
            replace="true" if replace else None,
        )
        return await self._tell(said)

    async def close(self, round: int) -> dict[str, Any]:
        """Ends this round with what was told of it; the rest has failed."""
        return await self._tell({"round": round, "close": True})

    async def _tell(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return await self._line.do(calls.tell(self.id, body, uuid.uuid4().hex))
