"""Ask and tell: an estimation whose experiments the caller carries out."""

from __future__ import annotations

import math
import time
import uuid
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from .. import requests
from ..request import drop_none
from ..proposal import Proposal, States, number_of, proposals, trial
from .job import AsyncJob

#: Interval between requests for proposals, s.
POLL_INTERVAL_S = 0.2


class AsyncAskTellJob(AsyncJob):
    """An ask-and-tell estimation: `await client.iplw(task, real="ask_tell")`.

    while proposals := await job.proposals():
        for proposal in proposals:
            await job.tell(proposal, *measure(proposal.scene))
    result = await job.wait()

    The server stores submitted results; after a restart of either side, continue with `await client.job(id)`. Submissions are
    retried after a lost connection and are idempotent.
    """

    async def proposals(self, *, all: bool = False, timeout: float | None = None) -> list[Proposal]:
        """The pending proposals; waits for the server to compute them. Empty once the job has ended.

        Proposals with a submitted result are included only if `all`. Raises `TimeoutError` after `timeout` seconds.
        """
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        while True:
            response = await self._connection.do(requests.proposals(self.id))
            if response["state"] != self.state:
                await self.refresh()
            pending = [p for p in proposals(response) if all or not p.answered]
            if pending or self.ended:
                return pending
            if time.monotonic() > deadline:
                raise TimeoutError(f"job {self.id} has no proposals within the timeout; call proposals() again")
            await self._connection.sleep(POLL_INTERVAL_S)

    async def tell(
        self, proposal: Proposal | int, t: ArrayLike, bodies: Mapping[str, States], *, replace: bool = False
    ) -> dict[str, Any]:
        """Submits the result of one proposal: times from 0 s, and the states of each body.

        t: (n,) s; bodies: name -> (n, 2) x and y of the centre, m, or (n, 3) with the angle, rad, or columns by name; NaN for
        missing values; `ValueError` for other shapes. Returns the progress of the round. Set `replace` to change a result
        that was already submitted.
        """
        return await self._tell({"trials": [trial(proposal, t, bodies)], **drop_none(replace=replace or None)})

    async def fail(self, proposals: Iterable[Proposal | int]) -> dict[str, Any]:
        """Reports that these proposals could not be carried out."""
        return await self._tell({"failed": [number_of(p) for p in proposals]})

    async def tell_csv(
        self, text: str, *, failed: Sequence[int] = (), close: bool = False, replace: bool = False
    ) -> dict[str, Any]:
        """Submits a trials file, `trial,t,body,x,y,...`, whose trials are named by the numbers of proposals."""
        body = drop_none(
            csv=text,
            failed=",".join(map(str, failed)) or None,
            close="true" if close else None,
            replace="true" if replace else None,
        )
        return await self._tell(body)

    async def close(self, round: int) -> dict[str, Any]:
        """Closes this round; proposals without a result count as failed."""
        return await self._tell({"round": round, "close": True})

    async def _tell(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return await self._connection.do(requests.tell(self.id, body, uuid.uuid4().hex))
