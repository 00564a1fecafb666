"""Lists of rows with HTML display and pandas frames."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from .display import chart
from .display.page import card, interval, side_by_side, table

if TYPE_CHECKING:
    import pandas


class Rows(list[dict[str, Any]]):
    """A list of rows as returned by the server."""

    def frame(self) -> pandas.DataFrame:
        """As a pandas data frame; nested fields have dotted names: `split.train`."""
        import pandas as pd

        return pd.json_normalize(list(self))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(f"<iplw.{type(self).__name__}: {len(self)}>")

    def _repr_html_(self) -> str:
        names = [name for name, value in self[0].items() if not isinstance(value, (dict, list))] if self else []
        return card(f"{len(self)} rows", table(names, [[row.get(name) for name in names] for row in self]))


class Rounds(Rows):
    """The history of an estimation, one row for each round."""

    def frame(self) -> pandas.DataFrame:
        """One row for each round and latent: `round,interactions,residual,name,value,low,high,identifiable`."""
        import pandas as pd

        names = ["round", "interactions", "residual", "name", "value", "low", "high", "identifiable"]
        rows = [
            (
                r["number"],
                r["interactions"],
                r["residual"],
                k["name"],
                k["value"],
                *map(_number, k["ci95"]),
                k["identifiable"],
            )
            for r in self
            for k in r["latents"]
        ]
        return pd.DataFrame(rows, columns=names).astype({"residual": float})

    def _repr_html_(self) -> str:
        curves: dict[str, list[tuple[float, float]]] = {}
        rows = []
        for r in self:
            for k in r["latents"]:
                if k["identifiable"]:
                    curves.setdefault(k["name"], []).append((float(r["interactions"]), float(k["value"])))
                interval_text = interval(k["ci95"]) if k["identifiable"] else "not identifiable"
                rows.append(
                    (
                        r["number"] + 1,
                        r["interactions"],
                        r["residual"],
                        k["name"],
                        k["value"] if k["identifiable"] else None,
                        interval_text,
                    )
                )
        charts = [
            chart.lines(name, [("", points)], x="interactions", width=260, height=120)
            for name, points in curves.items()
            if len(points) > 1
        ]
        head = ["round", "interactions", "residual (m²)", "latent", "value", "95 % interval"]
        return card("rounds", side_by_side(*charts), table(head, rows), note=str(len(self)))


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
