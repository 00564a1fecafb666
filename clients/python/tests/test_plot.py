"""`iplw.plot` draws results, pandas frames and NumPy arrays, without a display."""

from __future__ import annotations

import builtins
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from test_display import DIAGNOSIS, RESULTS

import iplw
from iplw.rollout import Rollout

matplotlib = pytest.importorskip("matplotlib")
pandas = pytest.importorskip("pandas")

T = np.linspace(0.0, 1.0, 5)
WAY = Rollout(
    True, None, True, 5, 0, 0, T, {"red": np.column_stack([T, T**2, 0 * T]), "ball": np.column_stack([T, 1 - T, 0 * T])}
)


@pytest.fixture
def ax() -> Iterator[Any]:
    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots()
    yield axes
    # Every figure can be rendered.
    figure.canvas.draw()
    plt.close("all")


def test_plots_trajectories(ax: Any) -> None:
    scene = {
        "bodies": [],
        "statics": [{"shape": {"type": "box", "half_width": 1, "half_height": 0.1}, "position": [0, 0]}],
    }
    assert iplw.plot.trajectory(WAY, scene=scene, ax=ax) is ax
    assert len(ax.patches) == 1 and np.array_equal(ax.lines[0].get_ydata(), T**2)
    assert ax.lines[0].get_color() == "tab:red"
    before = len(ax.lines)
    iplw.plot.trajectory(iplw.Rollouts([WAY, WAY]).frame(), ax=ax)
    assert len(ax.lines) == before + 4


def test_plots_mean_by_cell(ax: Any) -> None:
    attempted = np.array([[0.1, 0.1], [0.2, 0.2], [0.9, 0.9], [0.6, 0.1]])
    iplw.plot.actions(attempted, [1.0, 0.0, 1.0, np.nan], bins=2, ax=ax)
    sampled = np.ma.filled(ax.collections[0].get_array().reshape(2, 2).astype(float), np.nan)
    assert sampled[0, 0] == 0.5 and sampled[1, 1] == 1.0 and np.isnan(sampled[0, 1])
    invalid = Rollout(False, "overlaps", None, 0, 0, 0)
    iplw.plot.actions(attempted[:2], iplw.Rollouts([WAY, invalid]), bins=1, ax=ax)
    assert ax.collections[1].get_array().ravel()[0] == 1.0, "invalid actions do not count"
    with pytest.raises(ValueError, match=r"vectors has shape \(4, 2\), solved \(1,\)"):
        iplw.plot.actions(attempted, [1.0], ax=ax)


def test_plots_latents_and_rounds(ax: Any) -> None:
    estimate = iplw.Estimate(RESULTS["iplw"])
    iplw.plot.latents({"one": estimate, "two": estimate.frame()}, truth={"friction": 0.45, "density": 1.0}, ax=ax)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["friction"], "unidentifiable latents are omitted"
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"one", "two", "truth"}
    rounds = iplw.Rounds(
        [{"number": i, "interactions": 6 * i, "residual": None, "latents": RESULTS["iplw"]["latents"]} for i in (1, 2)]
    )
    iplw.plot.rounds(rounds, "friction", truth=0.45, ax=ax)
    assert any(list(line.get_xdata()) == [6, 12] and list(line.get_ydata()) == [0.5, 0.5] for line in ax.lines)
    with pytest.raises(ValueError, match="name is 'drag'; allowed: density, friction"):
        iplw.plot.rounds(rounds.frame(), "drag", ax=ax)


def test_plots_auccess(ax: Any, client: iplw.Client) -> None:
    score = client.policy("random").evaluate("bowling-sim", split="test", attempts=100).wait()
    assert isinstance(score, iplw.Score)
    # The same weights as the server's.
    assert iplw.plot.weighted(score.solved_within) == pytest.approx(score.auccess, rel=1e-12)
    iplw.plot.auccess({"random": score, "by hand": np.ones(100)}, ax=ax)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [f"random {score.auccess:.3f}", "by hand 1.000"]
    odd: list[Any] = [1.0, [], [0.2, np.nan], [[0.1]]]
    for bad_value in odd:
        with pytest.raises(ValueError, match=r"scores\['odd'\] is .*0 to 1"):
            iplw.plot.auccess({"odd": bad_value})


def test_plots_diagnoses(ax: Any) -> None:
    diagnosis = iplw.Diagnosis(DIAGNOSIS)
    iplw.plot.rivals(diagnosis, ax=ax)
    assert [bar.get_width() for bar in ax.patches] == [0.0, 1.0, 0.0, 40.0]
    points = diagnosis.points()
    iplw.plot.residuals(points, axis="x", ax=ax)
    assert ax.lines[-3].get_ydata()[8] == pytest.approx(80.0) and ax.lines[-2].get_ydata()[8] == pytest.approx(1.0)
    with pytest.raises(ValueError, match="axis is 'z'; allowed: x, y"):
        iplw.plot.residuals(points, axis="z", ax=ax)


def test_plots_training(ax: Any) -> None:
    iplw.plot.training(iplw.Training(RESULTS["train"]), ax=ax)
    assert list(ax.lines[0].get_ydata()) == [0.7, 0.5]


def test_missing_matplotlib_gives_install_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def absent(name: str, *args: Any) -> Any:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(ImportError, match=r"pip install 'iplw\[plot\]'"):
        iplw.plot.training(iplw.Training(RESULTS["train"]))
