"""Long work on the server: wait for it, watch it, cancel it."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from .errors import JobCancelled, JobFailed, Problem, ServerUnavailable
from . import calls
from .handle import Handle, Named

#: Time between two looks at a job where events do not come through, s.
POLL = 0.25
_ENDED = frozenset({"succeeded", "failed", "cancelled"})


class JobData(Named):
    """What is known of a job without asking."""

    _look = "get_job"

    @property
    def kind(self) -> str:
        """`iplw`, `train` or `evaluate`."""
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

    def result(self) -> dict[str, Any]:
        """The result of an ended job; raises as `wait` does, `RuntimeError` if it has not ended."""
        if self.state == "cancelled":
            raise JobCancelled(self.id)
        if self.state == "failed":
            error = self.data.get("error")
            raise JobFailed(self.id, Problem.from_json(500, error) if isinstance(error, dict) else None)
        if self.state != "succeeded":
            raise RuntimeError(f"job {self.id} is {self.state}; wait() for it first")
        result = self.data.get("result")
        return result if isinstance(result, dict) else {}


class Job(JobData, Handle):
    """A handle on one job."""

    def wait(self, progress: bool = False, timeout: float | None = None) -> dict[str, Any]:
        """The job's result, once it has one.

        `progress` draws a bar on stderr. Raises `JobFailed`, `JobCancelled`, or, after `timeout` seconds,
        `TimeoutError` (the job goes on; wait again or cancel it).
        """
        bar = Bar() if progress else None
        deadline = None if timeout is None else time.monotonic() + timeout
        try:
            self._follow(bar.draw if bar else None, deadline)
        finally:
            if bar:
                bar.finish()
        return self.result()

    def cancel(self) -> None:
        """Asks the server to stop the job; does nothing to one that has ended."""
        if self.refresh().ended:
            return
        self._transport.do(calls.cancel(self.id))

    def trials(self) -> list[dict[str, Any]]:
        """What an estimation has measured: `trial`, `proposal`, `task`, `action`, `t`, `bodies`, ..."""
        return list(self._transport.items("list_trials", "trials", {"id": self.id}))

    def save_trials(self, directory: str | Path) -> None:
        """Writes `trials.csv` and the `scene.json` that goes with it, as `iplw measure` does."""
        folder = Path(directory)
        folder.mkdir(parents=True, exist_ok=True)
        for format, name in (("csv", "trials.csv"), ("scene", "scene.json")):
            (folder / name).write_bytes(self._transport.do(calls.trials(self.id, format)))

    def _follow(self, watch: Callable[[dict[str, Any]], None] | None, deadline: float | None) -> None:
        """Brings `data` to the end of the job: by events if they come through, else by looking."""
        last_id, failures = "", 0
        while not self.ended:
            seen = last_id
            try:
                patience = math.inf if deadline is None else deadline - time.monotonic()
                for event in self._transport.events(self.id, last_id, patience) or ():
                    last_id = event.id or last_id
                    self.data = json.loads(event.data)
                    if watch:
                        watch(self.data)
                    if self.ended:
                        return
                    in_time(self.id, deadline)
            except (ServerUnavailable, ValueError):
                # Silence, a proxy that holds events back, or no server at all: looking tells which.
                pass
            except Problem as problem:
                if problem.status not in (404, 405, 406, 501):
                    raise
            self.refresh()
            if watch:
                watch(self.data)
            if self.ended:
                return
            in_time(self.id, deadline)
            failures = 0 if last_id != seen else failures + 1
            time.sleep(POLL if failures else 0.0)


def in_time(job: str, deadline: float | None) -> None:
    """Raises `TimeoutError` after the deadline."""
    if deadline is not None and time.monotonic() > deadline:
        raise TimeoutError(f"job {job} has not ended in time; it goes on: wait() again or cancel() it")


class Bar:
    """A plain-text progress bar: redrawn in place on a terminal, a line per stage elsewhere."""

    WIDTH = 30

    def __init__(self, out: TextIO | None = None) -> None:
        self._out = out or sys.stderr
        self._live = self._out.isatty()
        self._last = ""

    def draw(self, job: dict[str, Any]) -> None:
        progress = job.get("progress") or {}
        stage = str(progress.get("stage") or job.get("state") or "")
        done, total = float(progress.get("done") or 0), float(progress.get("total") or 0)
        if not self._live:
            if stage != self._last:
                self._out.write(f"{job.get('kind', 'job')}: {stage}\n")
                self._last = stage
            return
        share = min(done / total, 1.0) if total > 0 else 0.0
        full = round(share * self.WIDTH)
        line = f"{stage[:28]:28} [{'#' * full}{'.' * (self.WIDTH - full)}] {done:g}/{total:g}"
        left = progress.get("eta_s")
        if left is not None:
            line += f" {int(left) // 60}:{int(left) % 60:02} left"
        self._out.write("\r" + line.ljust(len(self._last)))
        self._out.flush()
        self._last = line

    def finish(self) -> None:
        if self._live and self._last:
            self._out.write("\n")
            self._out.flush()
