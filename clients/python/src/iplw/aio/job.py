"""Jobs: long-running operations on the server."""

from __future__ import annotations

import json
import math
import time
from collections.abc import AsyncGenerator
from contextlib import aclosing
# sync: from contextlib import suppress
from pathlib import Path
from typing import Any

from .. import requests
from ..errors import JobCancelled, JobFailed, Problem, ServerUnavailable
from ..notebook import job_card, progress_display
from ..results import Result, result_of
from ..rows import Rounds, Rows
from ..scene import Scene
from ..trials import Trials
from .resource import AsyncResource

#: Maximum polling interval if there are no events, s; it starts shorter, for short jobs.
MAX_POLL_INTERVAL_S = 0.25
_ENDED = frozenset({"succeeded", "failed", "cancelled"})


class AsyncJob(AsyncResource):
    """A job."""

    _get_operation = "get_job"

    @property
    def kind(self) -> str:
        """Kind of work: `iplw`, `diagnose`, `train`, `learn`, `evaluate`, `surface`, `posterior`, `likelihood`, `plan`, `design`."""
        return str(self.data["kind"])

    @property
    def name(self) -> str:
        """Name set by `rename`; empty if there is none."""
        return str(self.data.get("name", ""))

    @property
    def note(self) -> str:
        """Note set by `annotate`; empty if there is none."""
        return str(self.data.get("note", ""))

    @property
    def summary(self) -> str | None:
        """The result in a phrase, as of the last update; None if there is none."""
        summary = self.data.get("summary")
        return None if summary is None else str(summary)

    @property
    def state(self) -> str:
        """`queued`, `running`, `waiting`, `succeeded`, `failed` or `cancelled`, as of the last update."""
        return str(self.data["state"])

    @property
    def ended(self) -> bool:
        """Whether the job has ended, as of the last update."""
        return self.state in _ENDED

    @property
    def eta(self) -> float | None:
        """Estimated remaining time, s, as of the last update; None if unknown."""
        left = (self.data.get("progress") or {}).get("eta_s")
        return None if left is None else float(left)

    def result(self) -> Result:
        """The result of an ended job, an object of its kind's class (`iplw.Estimate`, ...).

        Raises as `wait` does, and `RuntimeError` if the job has not ended.
        """
        if self.state == "cancelled":
            raise JobCancelled(self.id)
        if self.state == "failed":
            error = self.data.get("error")
            raise JobFailed(self.id, Problem.from_json(500, error) if isinstance(error, dict) else None)
        if self.state != "succeeded":
            raise RuntimeError(f"job {self.id} is {self.state}; call wait() first")
        result = self.data.get("result")
        return result_of(self.kind, result if isinstance(result, dict) else {})

    async def wait(self, progress: bool = False, timeout: float | None = None) -> Result:
        """Waits for the end and returns the result: an `Estimate`, a `Diagnosis`, ..., each a dict.

        `progress` displays a card in a notebook, and a progress bar on stderr elsewhere. Raises `JobFailed`, `JobCancelled`,
        or, after `timeout` seconds, `TimeoutError` (the job continues).
        """
        display = progress_display() if progress else None
        try:
            async with aclosing(self.follow(timeout)) as states:
                async for data in states:
                    if display:
                        display.draw(data)
        finally:
            if display:
                display.finish()
        return self.result()

    async def follow(self, timeout: float | None = None) -> AsyncGenerator[dict[str, Any]]:
        """Yields `data` at each update until the job ends, from events if available, else by polling.

        Raises `TimeoutError` after `timeout` seconds.
        """
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        last_id, pause = "", MAX_POLL_INTERVAL_S / 16
        while not self.ended:
            previous_id = last_id
            try:
                max_silence = deadline - time.monotonic()
                async with aclosing(self._connection.events(self.id, last_id, max_silence)) as events:
                    async for event in events:
                        last_id = event.id or last_id
                        self.data = json.loads(event.data)
                        yield self.data
                        if self.ended:
                            return
                        self._check_deadline(deadline)
            except (ServerUnavailable, ValueError):
                # Silence, a proxy that buffers events, or no server: the next request distinguishes them.
                pass
            except Problem as problem:
                if problem.status not in (404, 405, 406, 429, 501, 503):
                    raise
            await self.refresh()
            yield self.data
            if self.ended:
                return
            self._check_deadline(deadline)
            if last_id == previous_id:
                await self._connection.sleep(pause)
                pause = min(2 * pause, MAX_POLL_INTERVAL_S)

    async def rename(self, name: str) -> None:
        """Sets the job's name: a line of at most 200 characters, empty for none. The job may have ended."""
        self.data = await self._connection.do(requests.annotate(self.id, name=name))

    async def annotate(self, note: str) -> None:
        """Sets the job's note: at most 10,000 characters, empty for none. The job may have ended."""
        self.data = await self._connection.do(requests.annotate(self.id, note=note))

    async def cancel(self) -> None:
        """Cancels the job; no effect on one that has ended."""
        await self.refresh()
        if not self.ended:
            await self._connection.do(requests.cancel(self.id))

    async def log(self, after: int = 0) -> Rows:
        """Log lines with a number greater than `after`: `number`, `at` (s since 1970), `level`, `text`."""
        return Rows(await self._connection.items("get_job_log", id=self.id, after=after))

    async def trials(self) -> Trials:
        """Trials that an estimation has measured or a diagnosis received: `trial`, `t` (s), `bodies` (m, rad); `proposal`, `task`, ..."""
        op = "list_diagnosis_trials" if self.kind == "diagnose" else "list_trials"
        return Trials(await self._connection.items(op, id=self.id))

    async def scene(self) -> Scene:
        """The scene of these trials; both are arguments of `Client.diagnose`."""
        if self.kind == "diagnose":
            response = await self._connection.do(requests.post("list_diagnosis_trials", {"id": self.id, "limit": 1}))
            return Scene(response["scene"])
        file = await self._connection.do(requests.trials(self.id, "scene"))
        return Scene(json.loads(file))

    async def rounds(self) -> Rounds:
        """The history of an estimation: `proposals`, `choice`, `residual`, `latents` with intervals, ... of each round."""
        return Rounds(await self._connection.items("list_rounds", id=self.id))

    async def save_trials(self, directory: str | Path) -> None:
        """Writes `trials.csv` and its `scene.json`, as `iplw measure` does."""
        folder = Path(directory)
        folder.mkdir(parents=True, exist_ok=True)
        for format, name in (("csv", "trials.csv"), ("scene", "scene.json")):
            file = await self._connection.do(requests.trials(self.id, format))
            (folder / name).write_bytes(file)

    def _repr_html_(self) -> str:
        log = Rows()
        # sync: # Display the current state, if the server responds.
        # sync: with suppress(Problem, ServerUnavailable):
        # sync:     self.refresh()
        # sync:     log = self.log()
        return job_card(self.data, log)

    def _check_deadline(self, deadline: float) -> None:
        if time.monotonic() > deadline:
            raise TimeoutError(f"job {self.id} has not ended within the timeout; it continues: call wait() again or cancel()")
