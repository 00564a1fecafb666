"""Measured trials, and a frame of them that `Client.diagnose` reads back."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .show.drawing import drawing
from .show.page import card, table

if TYPE_CHECKING:
    import pandas

#: Columns of a trials file that are there in any case, and those that are where they were measured.
COLUMNS = ("trial", "t", "body", "x", "y")
MORE = ("setting", "angle", "vx", "vy", "omega")
#: Trials that are drawn; more hide each other.
MOST_DRAWN = 24


class Trials(list[dict[str, Any]]):
    """Trials as the server tells them: `trial`, `t` and `bodies`, each with `x`, `y` and what else was measured."""

    def frame(self) -> pandas.DataFrame:
        """All of them as one pandas data frame, as a trials file has them: `trial,t,body,x,y,...`, by trial and time.

        What was not measured is NaN. `setting` is there where trials have one: where each has a scene of its own.
        """
        import pandas as pd

        parts = []
        for i, one in enumerate(self):
            for body, states in one["bodies"].items():
                measured = {name: _numbers(values) for name, values in states.items() if values is not None}
                known = {"order": i, "trial": one["trial"], "t": one["t"], "body": body, **measured}
                setting = one.get("setting", one["trial"] if "proposal" in one else None)
                parts.append(pd.DataFrame(known if setting is None else {**known, "setting": setting}))
        if not parts:
            return pd.DataFrame(columns=list(COLUMNS))
        frame = pd.concat(parts).sort_values(["order", "t"], kind="stable", ignore_index=True)
        return frame[[*COLUMNS, *(name for name in MORE if name in frame)]]

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(f"<iplw.Trials: {len(self)}>")

    def _repr_html_(self) -> str:
        tracks = []
        for one in self[:MOST_DRAWN]:
            ways = {}
            for body, states in one["bodies"].items():
                x, y = _numbers(states["x"]), _numbers(states["y"])
                turned = states.get("angle")
                ways[body] = np.column_stack([x, y, np.zeros(len(x)) if turned is None else _numbers(turned)])
            tracks.append(ways)
        rows = [
            (one["trial"], len(one["t"]), ", ".join(one["bodies"]), one["t"][-1] if one["t"] else None) for one in self
        ]
        shown = table(["trial", "observations", "bodies", "until (s)"], rows, most=6)
        return card("trials", drawing(None, tracks) if tracks else "", shown, note=str(len(self)))


def _numbers(values: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(n,) NaN where nothing was seen."""
    return np.array([math.nan if value is None else float(value) for value in values])
