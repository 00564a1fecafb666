"""HTML display in notebooks (self-contained, escaped, small, light and dark) and pandas frames."""

from __future__ import annotations

import re
import xml.etree.ElementTree as xml
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iplw
from iplw.notebook import job_card
from iplw.results import result_of
from iplw.display.drawing import drawing, extent
from iplw.display.page import card, table

NASTY = '<script>alert("x")</script>&'
BALL = {"name": NASTY, "shape": {"type": "disc", "radius": 0.02}, "position": [0.0, 1.0], "velocity": [3.0, 1.0]}
SHAPES: list[dict[str, Any]] = [
    {"type": "disc", "radius": 0.1},
    {"type": "box", "half_width": 0.2, "half_height": 0.1},
    {"type": "polygon", "vertices": [[0, 0], [0.2, 0], [0.1, 0.2]]},
    {"type": "segment", "from": [0, 0], "to": [0.2, 0.1], "radius": 0.01},
    {
        "type": "compound",
        "pieces": [{"type": "box", "half_width": 0.1, "half_height": 0.1, "position": [0.1, 0], "angle": 0.3}],
    },
    {"type": "halfspace", "normal": [0.0, 1.0], "offset": 0.0},
]
DIAGNOSIS: dict[str, Any] = {
    "verdict": "ambiguous",
    "reason": NASTY,
    "effects": [
        {
            "name": "wind",
            "acts_on": "motion",
            "probability": 0.97,
            "parameters": [
                {"name": "ax", "value": -1.0, "ci95": [-1.2, None], "unit": "m/s^2", "setting": None, "spread": 0.1}
            ],
        }
    ],
    "rivals": [["wind"], ["linear_drag"]],
    "calibrated": [{"name": "friction", "value": 0.5, "ci95": [None, None], "identifiable": False}],
    "scores": [
        {"effects": ["lift", "wind"], "score": 0.5, "probability": 0.4},
        {"effects": ["wind"], "score": 0.0, "probability": 0.4},
        {"effects": ["linear_drag"], "score": -1.0, "probability": 0.2},
        {"effects": [], "score": -40.0, "probability": 0.0},
    ],
    "gain": {"held_out": {"trials": 4, "base_rmse": 0.1, "extended_rmse": 0.01}},
    "evidence": {
        "points": {
            "columns": ["trial", "setting", "t", "before_x", "before_y", "after_x", "after_y"],
            "rows": [[0, 0, 0.1 * k, 0.01 * k, 0.0, 0.001, 0.0] for k in range(9)],
        }
    },
    "next_experiment": {"do": "throw", "why": "it parts them"},
    "next_scene": None,
    "extended_scene": {"name": "extended", "bodies": [BALL], "statics": []},
}
LATENTS = [
    {"name": "density", "value": 1.0, "ci95": [None, None], "identifiable": False},
    {"name": "friction", "value": 0.5, "ci95": [0.4, 0.6], "identifiable": True},
]
RESULTS: dict[str, dict[str, Any]] = {
    "iplw": {"latents": LATENTS, "residuals": [9.0, None, 1.0], "real_interactions": 12, "strategy": "mixed"},
    "diagnose": DIAGNOSIS,
    "train": {"policy": "policy-1", "loss": [0.7, 0.5], "validation": [{"batches": 2, "auccess": 0.6}], "examples": 9},
    "evaluate": {
        "auccess": 0.5,
        "solved_within": [0.5, 1.0],
        "tasks": [{"task": "a", "solved_at": None}],
        "interactions": 3,
    },
    "surface": {"surface": NASTY},
}


def complete(html: str) -> str:
    """Checks the rules for all displayed HTML."""
    assert "<script" not in html and "href=" not in html and "url(" not in html
    assert "prefers-color-scheme:dark" in html and '[data-jp-theme-light="false"]' in html and ".vscode-dark" in html
    assert len(html) < 200_000
    for sampled in re.findall(r"<svg.*?</svg>", html, re.DOTALL):
        xml.fromstring(sampled)
        assert "nan" not in sampled and "inf" not in sampled
    return html


@pytest.fixture
def rollouts(client: iplw.Client) -> Iterator[iplw.Rollouts]:
    with client.create_world("bowling:017") as world:
        world.reset()
        yield world.rollout(np.random.default_rng(1).random((30, 3)), trajectories=True)


def test_rollouts_display_and_frames(rollouts: iplw.Rollouts, client: iplw.Client) -> None:
    pandas = pytest.importorskip("pandas")
    complete(rollouts._repr_html_())
    one = rollouts[int(rollouts.valid.argmax())]
    html = complete(one._repr_html_())
    # The placed scene: the action sets the radius of the red ball.
    assert one.placed is not None and one.scene is not None and one.t is not None
    red = next(body for body in one.placed["bodies"] if body["name"] == "red")
    assert np.allclose(red["position"], one.bodies["red"][0, :2])
    assert f'<circle r="{red["shape"]["radius"]:.5g}"' in html
    rejected = rollouts[int((~rollouts.valid).argmax())]
    assert str(rejected.reason) in complete(rejected._repr_html_())
    frame = rollouts.frame()
    assert list(frame.columns) == ["trial", "t", "body", "x", "y", "angle"]
    assert set(frame["trial"]) == set(np.flatnonzero(rollouts.valid))
    part = frame[(frame["trial"] == int(rollouts.valid.argmax())) & (frame["body"] == "red")]
    assert (part[["x", "y", "angle"]].to_numpy() == one.bodies["red"]).all()
    outcomes = rollouts.outcomes()
    assert isinstance(outcomes, pandas.DataFrame) and (outcomes["valid"] == rollouts.valid).all()
    assert list(rollouts[:0].frame().columns) == list(frame.columns)


def test_accepts_pandas_inputs(client: iplw.Client) -> None:
    pandas = pytest.importorskip("pandas")
    actions = np.random.default_rng(2).random((5, 3))
    with client.create_world("bowling:017", latents=pandas.Series({"friction": 0.4})) as world:
        assert world.latents is not None and world.latents["friction"] == 0.4
        world.reset()
        world.set_latents(**pandas.Series({"restitution": np.float32(0.5)}))
        assert world.latents["restitution"] == 0.5
        message = [
            world.rollout(a).outcomes()
            for a in (actions, pandas.DataFrame(actions, columns=list("abc")), list(actions))
        ]
        assert message[0].equals(message[1]) and message[0].equals(message[2])
        indices = [world.rollout(a).outcomes() for a in (np.arange(5), pandas.Series(range(5)))]
        assert indices[0].equals(indices[1])
        step = world.step(pandas.Series([0.1, 0.14, 0.5], index=list("abc")))
        assert step[4]["valid"]
    frame = client.tasks().frame()
    assert {"bowling", "basketball"} <= set(frame["name"]) and frame["split.test"].min() > 0


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: str(shape["type"]))
def test_draws_every_shape(shape: dict[str, Any]) -> None:
    scene = iplw.Scene(
        name="one", bodies=[BALL], statics=[{"name": "it", "shape": shape, "position": [0.3, 0.2], "angle": 0.5}]
    )
    html = complete(scene._repr_html_())
    assert "&lt;script&gt;" in html
    empty = drawing({"bodies": [], "statics": []})
    assert drawing(scene).count("<") > empty.count("<") + 6


@pytest.mark.parametrize("line", [{"height": 1.0}, {"line": [[1, 1], [3, 1]]}, {"line": [[3, 1], [1, 1]]}], ids=str)
def test_marks_region_above_goal_line(line: dict[str, Any]) -> None:
    scene = {"bodies": [{**BALL, "position": [0.0, 0.5]}], "goal": {"type": "above", "body": BALL["name"], **line}}
    heights = {float(pair.split(",")[1]) for pair in drawing(scene).split('<polygon points="')[1].split('"')[0].split()}
    assert min(heights) == 1.0 and max(heights) > extent(scene)[3]


def test_drawing_contains_trajectories() -> None:
    track = {"ball": np.array([[0.0, 0.0, 0.0], [np.nan, np.nan, 0.0], [5.0, 1.0, 0.0], [6.0, 1.0, 0.0]])}
    remaining, bottom, right, top = extent(None, [track])
    assert remaining < 0.0 and right > 6.0 and bottom < 0.0 and top > 1.0
    # Missing observations interrupt the trajectory.
    assert drawing(None, [track]).count("M5 1L6 1") == 1
    assert drawing(None, [{"ball": np.full((3, 3), np.nan)}])


@pytest.mark.parametrize("kind", RESULTS)
def test_results_are_dicts_with_html(kind: str) -> None:
    pandas = pytest.importorskip("pandas")
    result = result_of(kind, RESULTS[kind])
    assert result == RESULTS[kind] and isinstance(result, dict)
    complete(result._repr_html_())
    assert isinstance(result.frame(), pandas.DataFrame)
    job = {"id": "job-1", "kind": kind, "state": "succeeded", "result": RESULTS[kind], "error": None}
    assert result._repr_html_() in complete(job_card(job))


@pytest.mark.parametrize("kind", RESULTS)
def test_saves_results_as_pages(kind: str, tmp_path: Path) -> None:
    result = result_of(kind, RESULTS[kind])
    path = result.save_html(tmp_path / "page.html")
    page = complete(path.read_text(encoding="utf-8"))
    assert path == tmp_path / "page.html" and result.save_html(str(tmp_path / "page.HTM")).read_text("utf-8") == page
    head, _, body = page.partition("<body>")
    assert head.startswith("<!DOCTYPE html>") and '<meta charset="utf-8">' in head
    assert f"<title>iplw: {type(result).__name__.lower()}</title>" in head
    assert body == f"\n{result._repr_html_()}\n</body>\n</html>\n"
    for name in ("page", "page.csv", "page.html.gz", "html"):
        with pytest.raises(ValueError, match=rf"path is '.*{name}'; allowed: a suffix of .html, .htm"):
            result.save_html(tmp_path / name)
    assert {file.name for file in tmp_path.iterdir()} == {"page.html", "page.HTM"}


def test_result_frames_have_nan_for_unknown() -> None:
    pytest.importorskip("pandas")
    estimate = iplw.Estimate(RESULTS["iplw"])
    frame = estimate.frame().set_index("name")
    assert (
        frame.loc["friction", "low"] == 0.4
        and np.isnan(frame.loc["density", "low"])
        and estimate.known == {"friction": 0.5}
    )
    diagnosis = iplw.Diagnosis(DIAGNOSIS)
    assert np.isnan(diagnosis.frame()["high"][0]) and diagnosis.frame()["low"][0] == -1.2
    scores = diagnosis.scores()
    assert list(scores["effects"]) == ["wind", "linear_drag", "lift + wind", "nothing"] and list(scores["rival"]) == [
        True,
        True,
        False,
        False,
    ]
    assert isinstance(diagnosis.extended_scene, iplw.Scene) and diagnosis.next_scene is None
    t, before, after = diagnosis.residuals()
    assert t.shape == (9,) and before[8, 0] == 0.08 and after[8, 0] == 0.001
    assert np.isnan(iplw.Score(RESULTS["evaluate"]).frame()["solved_at"][0])
    assert iplw.Training(RESULTS["train"]).frame()["auccess"][2] == 0.6


def test_displays_running_job() -> None:
    job = {
        "id": "job-1",
        "kind": "train",
        "state": "running",
        "progress": {"stage": NASTY, "done": 30, "total": 120, "eta_s": 65.0},
    }
    html = complete(job_card(job, [{"at": 0.0, "text": NASTY}], {"loss": [(1.0, 0.7), (2.0, 0.5)]}))
    assert "width:25.0%" in html and "1:05 left" in html and "&lt;script&gt;" in html and "<polyline" in html
    failed = {"id": "job-1", "kind": "train", "state": "failed", "error": {"detail": "out of luck"}}
    assert "out of luck" in complete(job_card(failed))


def test_displays_job_of_server(client: iplw.Client, tmp_path: Path) -> None:
    job = client.iplw("bowling", real={"damping": 1.0}, rounds=2, actions=3, samples=20, seed=1)
    estimate = job.wait()
    assert isinstance(estimate, iplw.Estimate)
    complete(estimate.save_html(tmp_path / "estimate.html").read_text(encoding="utf-8"))
    report = job.save_html(tmp_path / "report.html").read_text(encoding="utf-8")
    assert report == job.report() and '<main class="report">' in report and "<script" not in report
    html = complete(job._repr_html_())
    assert "<b>estimate</b>" in html and "<summary>log</summary>" in html and job.log()[-1]["text"] in html
    for visible in (job.trials(), job.rounds(), job.log(), job.scene(), client.tasks(), client.world("bowling-sim")):
        complete(visible._repr_html_())


def test_trials_round_trip(client: iplw.Client) -> None:
    pandas = pytest.importorskip("pandas")
    job = client.iplw("bowling", real={"damping": 0.8}, rounds=1, actions=2, samples=20, seed=1)
    job.wait()
    frame = job.trials().frame()
    assert list(frame.columns[:5]) == ["trial", "t", "body", "x", "y"] and frame["trial"].nunique() == 2
    values = client.diagnose(job.scene(), frame)
    try:
        back = values.trials().frame()
        for name in ("trial", "t", "body", "x", "y", "angle"):
            pandas.testing.assert_series_equal(frame[name], back[name])
        assert (frame.groupby("trial")["t"].diff().dropna() >= 0).all(), "sorted like a trials file"
        assert isinstance(values.scene(), iplw.Scene)
    finally:
        values.cancel()


def test_submits_frame_columns() -> None:
    pandas = pytest.importorskip("pandas")
    from iplw.proposal import trial

    frame = pandas.DataFrame({"y": [1.0, 2.0], "note": ["a", "b"], "x": [3.0, None]})
    assert trial(0, [0.0, 0.1], {"ball": frame})["bodies"]["ball"] == {"x": [3.0, None], "y": [1.0, 2.0]}


def test_places_actions() -> None:
    component = {"target": "ball", "low": 0.0, "high": 10.0}
    action = {"components": [{**component, "set": what} for what in ("x", "vy", "radius", "omega")]}
    scene = iplw.Scene(bodies=[BALL], statics=[], action=action)
    (ball,) = iplw.Scene({**scene, "bodies": [{**BALL, "name": "ball"}]}).placed([0.1, 0.2, 0.3, 0.4])["bodies"]
    assert ball["position"] == [1.0, 1.0] and ball["velocity"] == [3.0, 2.0]
    assert ball["shape"]["radius"] == 3.0 and ball["angular_velocity"] == 4.0
    assert BALL["position"] == [0.0, 1.0], "the scene is unchanged"
    with pytest.raises(ValueError, match=r"action has shape \(1,\); allowed: \(4,\)"):
        scene.placed([0.1])


def test_tables_are_truncated_and_escaped() -> None:
    html = table(["a"], [[NASTY]] * 40, max_rows=3)
    assert html.count("<td>") == 3 and "and 37 more" in html and "&lt;script&gt;" in html
    assert "&lt;script&gt;" in complete(card(NASTY, note=NASTY))
