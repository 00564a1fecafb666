"""Progress of a job in a notebook, as an HTML card that is updated in place."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from .progress import ProgressBar
from .results import result_of
from .display.chart import lines, progress_bar
from .display.page import card, details, paragraph, preformatted

#: Minimum time between two updates, s. More frequent updates flicker.
MIN_REDRAW_INTERVAL_S = 0.2
#: Displayed lines of the log.
MAX_LOG_LINES = 8


class ProgressDisplay(Protocol):
    """Displays the progress of a job."""

    def draw(self, job: dict[str, Any]) -> None:
        """Displays the current state of the job."""

    def finish(self) -> None:
        """Ends the display."""


def progress_display() -> ProgressDisplay:
    """An HTML card in a notebook, a progress bar elsewhere."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    # IPython in a terminal has no kernel and cannot display HTML.
    return NotebookProgress() if getattr(running, "kernel", None) is not None else ProgressBar()


class NotebookProgress:
    """A card of a job in a notebook's output, updated in place, with curves of the reported figures such as the loss."""

    def __init__(self) -> None:
        self._display: Any = None
        self._drawn_at = -MIN_REDRAW_INTERVAL_S
        self._job: dict[str, Any] = {}
        self._curves: dict[str, list[tuple[float, float]]] = {}

    def draw(self, job: dict[str, Any]) -> None:
        """Updates the card, at most once in `MIN_REDRAW_INTERVAL_S`."""
        self._job = job
        for figure in (job.get("progress") or {}).get("figures") or []:
            self._curves.setdefault(figure["name"], []).append((float(figure["at"]), float(figure["value"])))
        if time.monotonic() - self._drawn_at >= MIN_REDRAW_INTERVAL_S:
            self._redraw()

    def finish(self) -> None:
        """Displays the final state."""
        if self._job:
            self._redraw()

    def _redraw(self) -> None:
        screen: Any = importlib.import_module("IPython.display")
        html = screen.HTML(job_card({**self._job, "result": None}, curves=self._curves))
        if self._display is None:
            self._display = screen.display(html, display_id=True)
        else:
            self._display.update(html)
        self._drawn_at = time.monotonic()


def job_card(
    job: Mapping[str, Any],
    log: Sequence[Mapping[str, Any]] = (),
    curves: Mapping[str, list[tuple[float, float]]] | None = None,
) -> str:
    """HTML of a job: state, progress, curves, end of the log, and result."""
    parts = []
    progress = job.get("progress") or {}
    state = str(job.get("state", ""))
    if state in ("queued", "running", "waiting"):
        done, total = float(progress.get("done") or 0), float(progress.get("total") or 0)
        left = progress.get("eta_s")
        ahead = "" if left is None else f", {int(left) // 60}:{int(left) % 60:02} left"
        parts.append(paragraph(f"{progress.get('stage', '')}: {done:g} of {total:g}{ahead}"))
        parts.append(progress_bar(done / total if total else 0.0))
    if job.get("error"):
        error = job["error"]
        parts.append(paragraph(str(error.get("detail") or error.get("title") or error)))
    parts += [lines(name, [("", points)]) for name, points in (curves or {}).items()]
    if log:
        tail = "\n".join(
            f"{time.strftime('%H:%M:%S', time.localtime(line['at']))} {line['text']}" for line in log[-MAX_LOG_LINES:]
        )
        parts.append(details("log", preformatted(tail)))
    title = f"{job.get('kind', 'job')} {job.get('id', '')}".strip()
    name = job.get("name")
    top = card(f"{name} ({title})" if name else title, *parts, note=state)
    result = job.get("result")
    return top + (result_of(str(job.get("kind")), result)._repr_html_() if isinstance(result, Mapping) else "")
