"""A job's progress as text."""

from __future__ import annotations

import sys
from typing import Any, TextIO


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
