"""Results of jobs: dicts as returned by the server, with pandas frames and HTML display."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .scene import Scene
from .display import chart
from .display.page import card, details, document, interval, paragraph, side_by_side, table

if TYPE_CHECKING:
    import pandas

#: Displayed sets of effects, best first.
MAX_SETS = 8
#: Suffixes of pages that `save_html` writes.
HTML_SUFFIXES = (".html", ".htm")


def html_path(path: str | PathLike[str]) -> Path:
    """The path of a page; raises `ValueError` if it does not end like one."""
    path = Path(path)
    if path.suffix.lower() not in HTML_SUFFIXES:
        raise ValueError(f"path is {str(path)!r}; allowed: a suffix of {', '.join(HTML_SUFFIXES)}")
    return path


def result_of(kind: str, data: Mapping[str, Any]) -> Result:
    """The result of a job of this kind."""
    return _KINDS.get(kind, Result)(data)


class Result(dict[str, Any]):
    """The result of a job, a dict."""

    def frame(self) -> pandas.DataFrame:
        """As a pandas data frame, one row for each scalar: `name,value`."""
        import pandas as pd

        return pd.DataFrame(self._scalars(), columns=["name", "value"])

    def save_html(self, path: str | PathLike[str]) -> Path:
        """Writes what a notebook shows as a page of its own, without scripts or links; returns the path. `Job.save_html` writes the
        whole report."""
        path = html_path(path)
        path.write_text(document(f"iplw: {type(self).__name__.lower()}", self._repr_html_()), encoding="utf-8")
        return path

    def _scalars(self) -> list[tuple[str, Any]]:
        return [(key, value) for key, value in self.items() if isinstance(value, (str, int, float, type(None)))]

    def _repr_html_(self) -> str:
        return card("result", table(["", ""], self._scalars()))

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        # A notebook stores this text in addition to the HTML; the full text of a diagnosis is 200 kB.
        printer.text(f"<iplw.{type(self).__name__}: {', '.join(self)}>")


class Estimate(Result):
    """Estimated latents of a real world, and effect parameters fitted with them: job `iplw`."""

    @property
    def known(self) -> dict[str, float]:
        """Identifiable latents by name; arguments of `Client.train` and `World.set_latents`."""
        return {row["name"]: float(row["value"]) for row in self["latents"] if row["identifiable"]}

    @property
    def bad_fit(self) -> bool:
        """Whether the simulation cannot reproduce the trials: an effect is missing, and the intervals ignore it.

        `client.diagnose(job=...)` with the id of the estimation's job names it.
        """
        return (self.get("fit") or {}).get("adequate") is False

    def frame(self) -> pandas.DataFrame:
        """One row for each latent: `name,value,low,high,identifiable`; low and high, the 95 % interval, are NaN if unbounded."""
        return _latents_frame(self["latents"])

    def _repr_html_(self) -> str:
        residuals = [float("nan") if r is None else r for r in self.get("residuals", [])]
        line = [(i + 1.0, float(value)) for i, value in enumerate(residuals)]
        drawn = (
            chart.lines("residual of the best sample, m² per trajectory", [("", line)], x="round")
            if len(line) > 1
            else ""
        )
        note = f"{self.get('real_interactions')} real interactions in {len(line)} rounds, {self.get('strategy')}"
        text = str((self.get("fit") or {}).get("text", ""))
        fit = [paragraph(f"{'Bad fit' if self.bad_fit else 'Fit'}: {text}")] if text else []
        tables = _latents_table(self["latents"], ignores_misfit=self.bad_fit)
        return card("estimate", *fit, tables, side_by_side(_interval_chart(self["latents"]), drawn), note=note)


class Diagnosis(Result):
    """Missing effects of a simulation: an `iplw.diagnosis/2` document."""

    @property
    def verdict(self) -> str:
        """`none`, `named`, `ambiguous`, `unknown` or `insufficient_data`."""
        return str(self["verdict"])

    @property
    def extended_scene(self) -> Scene | None:
        """The scene with the estimated latents and effects; it can be simulated like any other."""
        return Scene(self["extended_scene"]) if self.get("extended_scene") else None

    @property
    def physics(self) -> dict[str, Any]:
        """The extended simulation, as arguments of `Client.train`: `latents` that are identifiable, and `effects`."""
        latents = {row["name"]: float(row["value"]) for row in self["calibrated"] if row["identifiable"]}
        scene = self.extended_scene
        return {"latents": latents, "effects": [] if scene is None else list(scene.get("effects", []))}

    @property
    def next_scene(self) -> Scene | None:
        """The scene of the recommended next experiment; None if it is not a throw."""
        return Scene(self["next_scene"]) if self.get("next_scene") else None

    def frame(self) -> pandas.DataFrame:
        """The effects, one row for each parameter: `effect,acts_on,parameter,value,low,high,unit`, `setting` (if it applies to
        one), `spread` (standard deviation between trials), `probability`; low and high are the 95 % interval."""
        import pandas as pd

        rows = [
            (
                e["name"],
                e["acts_on"],
                p["name"],
                p["value"],
                *_bounds(p["ci95"]),
                p["unit"],
                p["setting"],
                p["spread"],
                e["probability"],
            )
            for e in self["effects"]
            for p in e["parameters"]
        ]
        names = ["effect", "acts_on", "parameter", "value", "low", "high", "unit", "setting", "spread", "probability"]
        return pd.DataFrame(rows, columns=names)

    def scores(self) -> pandas.DataFrame:
        """Every fitted set of effects, the credible set first: `effects` (joined by `+`), `score` (log posterior
        relative to the best, nats), `probability`, `rival`."""
        import pandas as pd

        return pd.DataFrame(self.sets(), columns=["effects", "score", "probability", "rival"])

    def sets(self) -> list[tuple[str, float, float, bool]]:
        """The rows of `scores`."""
        rivals = {frozenset(rival) for rival in self.get("rivals", [])}
        rows = [
            (
                " + ".join(s["effects"]) or "nothing",
                float(s["score"]),
                float(s["probability"]),
                frozenset(s["effects"]) in rivals,
            )
            for s in self.get("scores", [])
        ]
        return sorted(rows, key=lambda row: (not row[3], -row[1]))

    def points(self) -> pandas.DataFrame:
        """Observations with residuals: `trial,setting,t,x,y,vx,vy,before_x,...,after_y`.

        The last four are measured - simulated, m, of the base model and of the extended model."""
        import pandas as pd

        points = self["evidence"]["points"]
        return pd.DataFrame(points["rows"], columns=points["columns"]).astype({"trial": int, "setting": int})

    def residuals(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """(n,) times, s, and (n, 2) residuals of the base and of the extended model, m, of the observations in `points`."""
        points = self["evidence"]["points"]
        table = np.array(points["rows"], dtype=np.float64).reshape(-1, len(points["columns"]))
        column = {name: table[:, i] for i, name in enumerate(points["columns"])}
        before, after = (np.column_stack([column[f"{when}_x"], column[f"{when}_y"]]) for when in ("before", "after"))
        return column["t"], before, after

    def _repr_html_(self) -> str:
        parameters = [
            (e["name"], e["acts_on"], p["name"], p["value"], interval(p["ci95"]), p["unit"])
            for e in self["effects"]
            for p in e["parameters"]
        ]
        parts = [paragraph(str(self.get("reason", "")))]
        if parameters:
            parts.append(table(["effect", "acts on", "parameter", "value", "95 % interval", "unit"], parameters))
        if len(self.get("rivals", [])) > 1:
            parts.append(paragraph("the data do not distinguish: " + "; ".join(" + ".join(r) or "nothing" for r in self["rivals"])))
        if self.get("calibrated"):
            parts.append(details("latents estimated with the effects", _latents_table(self["calibrated"])))
        parts.append(side_by_side(self._ranking(), self._residual_chart()))
        proposal = self.get("next_experiment")
        if proposal:
            parts.append(paragraph(f"next experiment: {proposal['do']} {proposal['why']}"))
        return card(f"diagnosis: {self.verdict}", *parts, note=self._gain_text())

    def _ranking(self) -> str:
        shown = [(name, max(-score, 0.0), rival) for name, score, _, rival in self.sets()[:MAX_SETS]]
        return chart.bars("nats below the reported set", shown) if shown else ""

    def _residual_chart(self) -> str:
        """Chart of the RMS residual over time, of the base and of the extended model."""
        if not (self.get("evidence") or {}).get("points", {}).get("rows"):
            return ""
        t, *both = self.residuals()
        edges = np.linspace(t.min(), t.max() + 1e-9, 25)
        bins = np.digitize(t, edges) - 1
        drawn = []
        for name, residuals in zip(("base model", "extended model"), both):
            squares = np.nansum(residuals**2, axis=1)
            points = [(float(t[bins == b].mean()), math.sqrt(float(squares[bins == b].mean()))) for b in np.unique(bins)]
            drawn.append((name, points))
        return chart.lines("residual, m (rms)", drawn, x="s")

    def _gain_text(self) -> str:
        gain = (self.get("gain") or {}).get("held_out")
        if not gain:
            return ""
        return (
            f"on {gain['trials']} held-out trials: RMSE {gain['base_rmse']:.3g} m before, {gain['extended_rmse']:.3g} m after"
        )


class Training(Result):
    """Training of a policy: jobs `train` and `learn`; `self["policy"]` is its id."""

    def frame(self) -> pandas.DataFrame:
        """One row for each batch, from 1: `loss` (binary cross-entropy, nats) and, if evaluated, `auccess`."""
        import pandas as pd

        loss = self.get("loss", [])
        frame = pd.DataFrame({"loss": loss}, index=pd.RangeIndex(1, len(loss) + 1, name="batch"))
        seen = {row["batches"]: row["auccess"] for row in self.get("validation") or []}
        frame["auccess"] = [seen.get(batch, math.nan) for batch in frame.index]
        return frame

    def _repr_html_(self) -> str:
        loss = [(i + 1.0, float(value)) for i, value in enumerate(self.get("loss", []))]
        seen = [(float(row["batches"]), float(row["auccess"])) for row in self.get("validation") or []]
        drawn = [
            chart.lines("loss, nats", [("", loss)], x="batches"),
            chart.lines("AUCCESS, validation tasks", [("", seen)], x="batches"),
        ]
        facts = [(key, self[key]) for key in ("examples", "solving", "interactions") if self.get(key) is not None]
        return card("training", side_by_side(*drawn), table(["", ""], facts), note=f"policy {self.get('policy')}")


def weighted(curve: NDArray[np.float64]) -> float:
    """AUCCESS: the mean of the curve with weights log(k + 1) - log(k) for attempt k."""
    k = np.arange(1, len(curve) + 1)
    return float(np.average(curve, weights=np.log(k + 1) - np.log(k)))


class Score(Result):
    """AUCCESS of a policy in a world: job `evaluate`."""

    @property
    def auccess(self) -> float:
        """Mean share of tasks solved within k attempts, weighted by log(k + 1) - log(k): 0 to 1."""
        return float(self["auccess"])

    @property
    def solved_within(self) -> NDArray[np.float64]:
        """(attempts,) share of tasks solved within 1, 2, ... attempts."""
        return np.asarray(self["solved_within"], dtype=np.float64)

    def frame(self) -> pandas.DataFrame:
        """One row for each task: `task,solved_at` (the attempt that solved it, from 1; NaN if unsolved)."""
        import pandas as pd

        rows = [(row["task"], row["solved_at"]) for row in self.get("tasks", [])]
        return pd.DataFrame(rows, columns=["task", "solved_at"]).astype({"solved_at": float})

    def _repr_html_(self) -> str:
        curve = [(k + 1.0, float(share)) for k, share in enumerate(self["solved_within"])]
        drawn = chart.lines("share of tasks solved", [("", curve)], x="attempts")
        solved = sum(row["solved_at"] is not None for row in self.get("tasks", []))
        facts = [
            ("AUCCESS", self["auccess"]),
            ("tasks solved", f"{solved} of {len(self.get('tasks', []))}"),
            ("attempts", self.get("interactions")),
        ]
        return card("score", side_by_side(table(["", ""], facts), drawn), note=f"{self.get('world_kind', '')} world")


_KINDS: dict[str, type[Result]] = {
    "iplw": Estimate,
    "diagnose": Diagnosis,
    "train": Training,
    "learn": Training,
    "evaluate": Score,
}


def _latents_frame(rows: Sequence[Mapping[str, Any]]) -> pandas.DataFrame:
    import pandas as pd

    table = [(row["name"], row["value"], *_bounds(row["ci95"]), row["identifiable"]) for row in rows]
    return pd.DataFrame(table, columns=["name", "value", "low", "high", "identifiable"])


def _latents_table(rows: Sequence[Mapping[str, Any]], ignores_misfit: bool = False) -> str:
    shown = [
        (row["name"], row["value"], interval(row["ci95"]))
        if row["identifiable"]
        else (row["name"], None, "not identifiable")
        for row in rows
    ]
    heading = "95 % interval (ignores the misfit)" if ignores_misfit else "95 % interval"
    return table(["latent", "value", heading], shown)


def _interval_chart(rows: Sequence[Mapping[str, Any]]) -> str:
    rows_with_value = [(row["name"], float(row["value"]), *_bounds(row["ci95"])) for row in rows if row["identifiable"]]
    return chart.intervals([row for row in rows_with_value if all(map(math.isfinite, row[1:]))])


def _bounds(ci95: Sequence[float | None] | None) -> tuple[float, float]:
    low, high = ci95 or (None, None)
    return (math.nan if low is None else float(low)), (math.nan if high is None else float(high))
