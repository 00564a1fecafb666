"""Measured trials, with a pandas frame that `Client.diagnose` reads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .display.drawing import drawing
from .display.page import card, table

if TYPE_CHECKING:
    import pandas

#: Columns of a trials file that are always present, and optional ones.
REQUIRED_COLUMNS = ("trial", "t", "body", "x", "y")
OPTIONAL_COLUMNS = ("setting", "angle", "vx", "vy", "omega")
#: Number of trials drawn.
MAX_DRAWN = 24


class Trials(list[dict[str, Any]]):
    """Trials: `trial`, `t` and `bodies`, each with `x`, `y` and further measured columns."""

    def frame(self) -> pandas.DataFrame:
        """All trials as one pandas data frame in the format of a trials file: `trial,t,body,x,y,...`, by trial and time.

        Missing values are NaN. `setting` is present if trials have one, or if each has its own scene.
        """
        import pandas as pd

        parts = []
        for i, trial in enumerate(self):
            for body, states in trial["bodies"].items():
                measured = {name: _numbers(values) for name, values in states.items() if values is not None}
                columns = {"order": i, "trial": trial["trial"], "t": trial["t"], "body": body, **measured}
                setting = trial.get("setting", trial["trial"] if "proposal" in trial else None)
                parts.append(pd.DataFrame(columns if setting is None else {**columns, "setting": setting}))
        if not parts:
            return pd.DataFrame(columns=list(REQUIRED_COLUMNS))
        frame = pd.concat(parts).sort_values(["order", "t"], kind="stable", ignore_index=True)
        return frame[[*REQUIRED_COLUMNS, *(name for name in OPTIONAL_COLUMNS if name in frame)]]

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(f"<iplw.Trials: {len(self)}>")

    def _repr_html_(self) -> str:
        tracks = []
        for trial in self[:MAX_DRAWN]:
            tracks_by_body = {}
            for body, states in trial["bodies"].items():
                x, y = _numbers(states["x"]), _numbers(states["y"])
                angle = states.get("angle")
                tracks_by_body[body] = np.column_stack([x, y, np.zeros(len(x)) if angle is None else _numbers(angle)])
            tracks.append(tracks_by_body)
        rows = [
            (trial["trial"], len(trial["t"]), ", ".join(trial["bodies"]), trial["t"][-1] if trial["t"] else None) for trial in self
        ]
        listing = table(["trial", "observations", "bodies", "until (s)"], rows, max_rows=6)
        return card("trials", drawing(None, tracks) if tracks else "", listing, note=str(len(self)))


def _numbers(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(n,) with NaN for missing values."""
    return np.array([math.nan if value is None else float(value) for value in values])
