"""A job's progress in a notebook: a card that is redrawn in place."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from .bar import Bar
from .results import result_of
from .show.chart import lines, progress
from .show.page import card, folded, preformatted, said

#: Least time between two drawings, s: a page that is redrawn more often flickers and grows.
PACE = 0.2
#: Lines of a log that are shown.
TAIL = 8


class Progress(Protocol):
    """Draws a job again and again."""

    def draw(self, job: dict[str, Any]) -> None:
        """Draws what the server says of it now."""

    def finish(self) -> None:
        """Nothing more will be drawn."""


def watching() -> Progress:
    """A card in a notebook, a bar elsewhere."""
    shell = sys.modules.get("IPython")
    running = shell.get_ipython() if shell is not None else None
    # A terminal's shell has no kernel, and shows no HTML.
    return Live() if getattr(running, "kernel", None) is not None else Bar()


class Live:
    """A card of a job in a notebook's output, redrawn in place; the curve of what the work tells grows with it."""

    def __init__(self) -> None:
        self._display: Any = None
        self._drawn = -PACE
        self._job: dict[str, Any] = {}
        self._curves: dict[str, list[tuple[float, float]]] = {}

    def draw(self, job: dict[str, Any]) -> None:
        """Draws it, unless it was drawn just now."""
        self._job = job
        for figure in (job.get("progress") or {}).get("figures") or []:
            self._curves.setdefault(figure["name"], []).append((float(figure["at"]), float(figure["value"])))
        if time.monotonic() - self._drawn >= PACE:
            self._show()

    def finish(self) -> None:
        """Draws how it ended."""
        if self._job:
            self._show()

    def _show(self) -> None:
        screen: Any = importlib.import_module("IPython.display")
        shown = screen.HTML(job_card({**self._job, "result": None}, curves=self._curves))
        if self._display is None:
            self._display = screen.display(shown, display_id=True)
        else:
            self._display.update(shown)
        self._drawn = time.monotonic()


def job_card(
    job: Mapping[str, Any],
    log: Sequence[Mapping[str, Any]] = (),
    curves: Mapping[str, list[tuple[float, float]]] | None = None,
) -> str:
    """What is known of a job: its state, how far it is, what it told, its log's end, and what it came to."""
    parts = []
    now = job.get("progress") or {}
    state = str(job.get("state", ""))
    if state in ("queued", "running", "waiting"):
        done, total = float(now.get("done") or 0), float(now.get("total") or 0)
        left = now.get("eta_s")
        ahead = "" if left is None else f", {int(left) // 60}:{int(left) % 60:02} left"
        parts.append(said(f"{now.get('stage', '')}: {done:g} of {total:g}{ahead}"))
        parts.append(progress(done / total if total else 0.0))
    if job.get("error"):
        error = job["error"]
        parts.append(said(str(error.get("detail") or error.get("title") or error)))
    parts += [lines(name, [("", points)]) for name, points in (curves or {}).items()]
    if log:
        tail = "\n".join(
            f"{time.strftime('%H:%M:%S', time.localtime(line['at']))} {line['text']}" for line in log[-TAIL:]
        )
        parts.append(folded("log", preformatted(tail)))
    top = card(f"{job.get('kind', 'job')} {job.get('id', '')}".strip(), *parts, note=state)
    result = job.get("result")
    return top + (result_of(str(job.get("kind")), result)._repr_html_() if isinstance(result, Mapping) else "")
