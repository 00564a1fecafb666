# Made by `generate.py` from `aio/job.py`; change that.
"""Long work on the server: wait for it, watch it, cancel it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator
from contextlib import closing
from contextlib import suppress
from pathlib import Path
from typing import Any

from .. import calls
from ..errors import JobCancelled, JobFailed, Problem, ServerUnavailable
from ..live import job_card, watching
from ..results import Result, result_of
from ..rows import Rounds, Rows
from ..scene import Scene
from ..trials import Trials
from .handle import Handle

#: Longest time between two looks at a job where events do not come through, s; often at first, for the short ones.
POLL = 0.25
_ENDED = frozenset({"succeeded", "failed", "cancelled"})


class Job(Handle):
    """A handle on one job."""

    _look = "get_job"

    @property
    def kind(self) -> str:
        """What it does: `iplw`, `diagnose`, `train`, `learn`, `evaluate`, `surface`, `posterior`, `likelihood`, `plan`."""
        return str(self.data["kind"])

    @property
    def state(self) -> str:
        """`queued`, `running`, `waiting`, `succeeded`, `failed` or `cancelled`, as of the last look."""
        return str(self.data["state"])

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen, as of the last look."""
        return self.state in _ENDED

    @property
    def eta(self) -> float | None:
        """Seconds left at the rate so far, as of the last look; None while not known."""
        left = (self.data.get("progress") or {}).get("eta_s")
        return None if left is None else float(left)

    def result(self) -> Result:
        """The result of an ended job, a dict of its kind's class (`iplw.Estimate`, ...).

        Raises as `wait` does, and `RuntimeError` if it has not ended.
        """
        if self.state == "cancelled":
            raise JobCancelled(self.id)
        if self.state == "failed":
            error = self.data.get("error")
            raise JobFailed(self.id, Problem.from_json(500, error) if isinstance(error, dict) else None)
        if self.state != "succeeded":
            raise RuntimeError(f"job {self.id} is {self.state}; wait() for it first")
        result = self.data.get("result")
        return result_of(self.kind, result if isinstance(result, dict) else {})

    def wait(self, progress: bool = False, timeout: float | None = None) -> Result:
        """The job's result, once it has one: an `Estimate`, a `Diagnosis`, ..., each a dict.

        `progress` draws a card that changes in place in a notebook, and a bar on stderr elsewhere. Raises `JobFailed`, `JobCancelled`, or, after `timeout` seconds,
        `TimeoutError` (the job goes on; wait again or cancel it).
        """
        bar = watching() if progress else None
        try:
            with closing(self.follow(timeout)) as states:
                for data in states:
                    if bar:
                        bar.draw(data)
        finally:
            if bar:
                bar.finish()
        return self.result()

    def follow(self, timeout: float | None = None) -> Generator[dict[str, Any]]:
        """What the server says of the job, `data`, again and again until it ends.

        By events if they come through, else by looking. After `timeout` seconds, `TimeoutError`.
        """
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        last_id, pause = "", POLL / 16
        while not self.ended:
            seen = last_id
            try:
                patience = deadline - time.monotonic()
                with closing(self._line.events(self.id, last_id, patience)) as events:
                    for event in events:
                        last_id = event.id or last_id
                        self.data = json.loads(event.data)
                        yield self.data
                        if self.ended:
                            return
                        self._in_time(deadline)
            except (ServerUnavailable, ValueError):
                # Silence, a proxy that holds events back, or no server at all: looking tells which.
                pass
            except Problem as problem:
                if problem.status not in (404, 405, 406, 429, 501, 503):
                    raise
            self.refresh()
            yield self.data
            if self.ended:
                return
            self._in_time(deadline)
            if last_id == seen:
                self._line.sleep(pause)
                pause = min(2 * pause, POLL)

    def cancel(self) -> None:
        """Asks the server to stop the job; does nothing to one that has ended."""
        self.refresh()
        if not self.ended:
            self._line.do(calls.cancel(self.id))

    def log(self, after: int = 0) -> Rows:
        """What happened to it, line by line: `number`, `at` (s since 1970), `level`, `text`; those after a number."""
        return Rows(self._line.items("get_job_log", id=self.id, after=after))

    def trials(self) -> Trials:
        """What an estimation has measured, or a diagnosis was given: `trial`, `t` (s), `bodies` (m, rad); `proposal`, `task`, ..."""
        op = "list_given_trials" if self.kind == "diagnose" else "list_trials"
        return Trials(self._line.items(op, id=self.id))

    def scene(self) -> Scene:
        """The scene that these trials go with; with them it is what `Client.diagnose` takes."""
        if self.kind == "diagnose":
            given = self._line.do(calls.post("list_given_trials", {"id": self.id, "limit": 1}))
            return Scene(given["scene"])
        file = self._line.do(calls.trials(self.id, "scene"))
        return Scene(json.loads(file))

    def rounds(self) -> Rounds:
        """The course of an estimation: `proposals`, `choice`, `residual`, `latents` with intervals, ... of each round."""
        return Rounds(self._line.items("list_rounds", id=self.id))

    def save_trials(self, directory: str | Path) -> None:
        """Writes `trials.csv` and the `scene.json` that goes with it, as `iplw measure` does."""
        folder = Path(directory)
        folder.mkdir(parents=True, exist_ok=True)
        for format, name in (("csv", "trials.csv"), ("scene", "scene.json")):
            file = self._line.do(calls.trials(self.id, format))
            (folder / name).write_bytes(file)

    def _repr_html_(self) -> str:
        log = Rows()
        # What is shown is how it stands now, as far as the server can be asked.
        with suppress(Problem, ServerUnavailable):
            self.refresh()
            log = self.log()
        return job_card(self.data, log)

    def _in_time(self, deadline: float) -> None:
        if time.monotonic() > deadline:
            raise TimeoutError(f"job {self.id} has not ended in time; it goes on: wait() again or cancel() it")
