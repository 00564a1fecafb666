"""A job's progress as a tqdm bar on stderr."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, TextIO

from tqdm import tqdm

#: Description, share, counts, and the remaining time that the server estimates.
_BAR_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:g}/{total:g}{postfix}"


class ProgressBar:
    """A tqdm bar on a terminal; elsewhere one line for each stage."""

    def __init__(self, out: TextIO | None = None) -> None:
        self._out = out or sys.stderr
        self._bar: tqdm[Any] | None = None
        self._stage = ""

    def draw(self, job: Mapping[str, Any]) -> None:
        """Shows the job's current stage and progress."""
        progress = job.get("progress") or {}
        stage = str(progress.get("stage") or job.get("state") or "")
        if not self._out.isatty():
            if stage != self._stage:
                print(f"{job.get('kind', 'job')}: {stage}", file=self._out, flush=True)
                self._stage = stage
            return
        if self._bar is None:
            self._bar = tqdm(total=0, file=self._out, bar_format=_BAR_FORMAT, dynamic_ncols=True)
        self._bar.total = float(progress.get("total") or 0)
        self._bar.n = min(float(progress.get("done") or 0), self._bar.total)
        self._bar.set_description_str(stage, refresh=False)
        self._bar.set_postfix_str(remaining_time(progress.get("eta_s")), refresh=False)
        self._bar.refresh()

    def finish(self) -> None:
        """Ends the bar's line."""
        if self._bar is not None:
            self._bar.close()


def remaining_time(eta_s: float | None) -> str:
    """`2:05 left`; empty if the remaining time is unknown."""
    return "" if eta_s is None else f"{int(eta_s) // 60}:{int(eta_s) % 60:02} left"
