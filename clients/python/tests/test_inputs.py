"""Input formats of measured trials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import iplw
import numpy as np
import pytest
from iplw.inputs import trial_texts

pandas = pytest.importorskip("pandas")

BALL = {"radius": 0.02, "mass": 0.0027}
K = 0.15


def throw(speed: float, angle: float, seed: int) -> np.ndarray[Any, Any]:
    """t, x, y of a ball with quadratic drag (K per m), 0.2 mm of noise, 60 frames in 0.6 s."""
    state = np.array([0.0, 1.0, speed * np.cos(angle), speed * np.sin(angle)])
    rows, steps = [], 10
    for k in range(60):
        rows.append([k * 0.01, state[0], state[1]])
        for _ in range(steps):
            half = state + 0.5 * 0.001 * _change(state)
            state = state + 0.001 * _change(half)
    table = np.array(rows)
    table[:, 1:] += np.random.default_rng(seed).normal(0.0, 2e-4, (60, 2))
    return table


def _change(state: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    _, _, vx, vy = state
    speed = np.hypot(vx, vy)
    return np.array([vx, vy, -K * speed * vx, -9.81 - K * speed * vy])


THROWS = [throw(3.0 + 0.7 * i, 0.3 + 0.1 * (i % 4), i) for i in range(8)]


def frame() -> Any:
    """All throws as one frame with common column names."""
    parts = [pandas.DataFrame(table, columns=["Time (s)", "pos_x", "pos_y"]).assign(launch=i) for i, table in enumerate(THROWS)]
    return pandas.concat(parts, ignore_index=True)


def test_reads_encodings_of_windows_programs(tmp_path: Path) -> None:
    text = "t,x (µm),y\n0,1,2\n"
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "latin-1"):
        path = tmp_path / f"{encoding}.csv"
        path.write_bytes(text.encode(encoding))
        assert trial_texts(path) == text
    path.write_bytes(b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ValueError, match="is HDF5; allowed: a table as text"):
        trial_texts(path)


def test_frames_arrays_and_files_are_equivalent(client: iplw.Client, tmp_path: Path) -> None:
    files = []
    for i, table in enumerate(THROWS):
        files.append(tmp_path / f"throw{i}.txt")
        rows = "".join(f"{t!r}\t{x!r}\t{y!r}\t\n" for t, x, y in table.tolist())
        files[-1].write_text(f"mass_A\nt\tx\ty\t\n{rows}")
    frame().to_csv(tmp_path / "all.csv")
    forms: list[Any] = [frame(), THROWS, files, tmp_path / "all.csv", str(tmp_path / "all.csv")]
    result = [client.diagnose(trials=form, ball=BALL).wait() for form in forms]
    effects = [{e["name"]: e["parameters"][0]["value"] for e in one["effects"]} for one in result]
    assert all(any("drag" in name or name == "moving_air" for set in one["rivals"] for name in set) for one in result)
    assert all(one == effects[0] for one in effects), effects
    scene = result[0]["extended_scene"] | {"effects": []}
    again = client.diagnose(scene, THROWS).wait()
    assert again["verdict"] == result[0]["verdict"]


def test_requires_units(client: iplw.Client) -> None:
    pixels = [np.column_stack([t * 240, x / 0.002, -y / 0.002]) for t, x, y in (table.T for table in THROWS)]
    with pytest.raises(iplw.Problem, match="metres_per_pixel") as error:
        client.diagnose(trials=pixels, ball=BALL)
    assert error.value.status == 422
    reading = {"fps": 240, "metres_per_pixel": 0.002, "y_down": True}
    assert client.diagnose(trials=pixels, ball=BALL, reading=reading).data["config"]["trials"] == len(THROWS)
    for request, field in [
        ({"ball": {"radius": -1.0}, "trials": THROWS}, "ball.radius"),
        ({"ball": BALL, "trials": THROWS, "reading": {"length_unit": "yd"}}, "reading.length_unit"),
        ({"ball": BALL, "trials": {"a": "t,x,y\n0,1,oops\n"}}, "trials.y"),
        ({"ball": BALL, "scene": {}, "trials": THROWS}, "scene"),
    ]:
        with pytest.raises(iplw.Problem) as error:
            client.diagnose(**request)  # type: ignore[arg-type]
        assert (error.value.field or "").startswith(field), error.value


def test_converts_trials_to_text() -> None:
    text = "t,x,y\n0,1,2\n"
    assert trial_texts(text) == text
    assert trial_texts([[[0.0, 1.0, float("nan")]]]) == {"1": "t,x,y\n0.0,1.0,\n"}
    assert trial_texts(np.array([[0.0, 1.0, 2.5]])) == "t,x,y\n0.0,1.0,2.5\n"
    named = pandas.DataFrame({"x": [1.0], "y": [2.0]}, index=pandas.Index([0.5], name="t"))
    assert trial_texts({"a": named}) == {"a": "t,x,y\n0.5,1.0,2.0\n"}
    assert trial_texts(pandas.DataFrame({"t": [0.5], "x": [1.0], "y": [None]})) == "t,x,y\n0.5,1.0,\n"
    with pytest.raises(ValueError, match=r"trials\[1\] has shape \(1, 2\); allowed: \(n, 3\)"):
        trial_texts([np.zeros((1, 3)), np.zeros((1, 2))])
    with pytest.raises(ValueError, match="empty"):
        trial_texts([])
