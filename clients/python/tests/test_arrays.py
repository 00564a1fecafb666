"""Rollouts of the command line as NumPy arrays."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from iplw import codec
from iplw.binary import find_binary

BINARY = find_binary()

SCENE: dict[str, Any] = {
    "format": "iplw.scene/1",
    "bodies": [
        {"name": "a", "shape": {"type": "disc", "radius": 0.2}, "position": [0.0, 2.0], "friction": 0.4, "restitution": 0.6},
        {"name": "b", "shape": {"type": "box", "half_width": 0.2, "half_height": 0.1}, "position": [1.0, 2.0]},
    ],
    "statics": [{"name": "floor", "shape": {"type": "box", "half_width": 5.0, "half_height": 0.5}, "position": [0.0, -0.5]}],
    "gravity": [0.0, -9.8],
    "time_step": 0.005,
    "steps": 300,
    "observe_every": 7,
}
COUNT = 50


def rollout(folder: Path, *arguments: str, arrays: dict[str, Any]) -> subprocess.CompletedProcess[str]:
    (folder / "scene.json").write_text(json.dumps(SCENE))
    np.savez(folder / "in.npz", **arrays)
    command = [str(BINARY), "rollout", "--scene", str(folder / "scene.json"), "--in", str(folder / "in.npz"), "--out", str(folder / "out.npz"), *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def inputs() -> dict[str, Any]:
    random = np.random.default_rng(1)
    position = np.array([[0.0, 2.0], [1.0, 2.0]]) + random.uniform(-0.2, 0.2, (COUNT, 2, 2))
    return {
        "position": position,
        "velocity": random.normal(0, 1, (COUNT, 2, 2)),
        "angle": random.uniform(-1, 1, (COUNT, 2)),
        "friction": random.uniform(0.1, 0.9, COUNT),
        "linear_drag.c": random.uniform(0, 1, COUNT),
    }


def test_arrays_have_the_bits_of_single_scenes(tmp_path: Path) -> None:
    arrays = inputs()
    done = rollout(tmp_path, arrays=arrays)
    assert done.returncode == 0, done.stderr
    lines = []
    for i in range(COUNT):
        scene = json.loads(json.dumps(SCENE))
        for b, body in enumerate(scene["bodies"]):
            body |= {"position": arrays["position"][i, b].tolist(), "velocity": arrays["velocity"][i, b].tolist(), "angle": arrays["angle"][i, b]}
            body["friction"] = arrays["friction"][i]
        scene["effects"] = [{"name": "linear_drag", "parameters": {"c": arrays["linear_drag.c"][i]}}]
        lines.append(json.dumps(scene))
    singles = subprocess.run([str(BINARY), "rollout"], input="\n".join(lines), capture_output=True, text=True, check=True).stdout.splitlines()
    with np.load(tmp_path / "out.npz") as out:
        assert out["bodies"].tolist() == ["a", "b"]
        assert json.loads(str(out["about"]))["engine"] == "lanes"
        assert out["position"].shape == (COUNT, len(out["t"]), 2, 2)
        assert (out["solved"] == -1).all() and (out["end"] == 0).all() and (out["steps"] == 300).all()
        for i, line in enumerate(map(json.loads, singles)):
            assert line["t"] == out["t"].tolist()
            assert line["contacts"] == {"collisions": out["collisions"][i], "rolling_steps": out["rolling_steps"][i]}
            for b, name in enumerate(["a", "b"]):
                for k, axis in enumerate("xy"):
                    assert line["bodies"][name][axis] == out["position"][i, :, b, k].tolist()
                assert line["bodies"][name]["angle"] == out["angle"][i, :, b].tolist()


def test_outcomes_alone_have_no_samples(tmp_path: Path) -> None:
    done = rollout(tmp_path, "--no-samples", arrays=inputs())
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "out.npz") as out:
        assert "position" not in out and len(out["steps"]) == COUNT and out["collisions"].dtype == np.int32


@pytest.mark.parametrize(
    "arrays, wanted",
    [
        ({"position": np.zeros((3, 1, 2))}, "position"),
        ({"speed": np.zeros(3)}, "speed"),
        ({"linear_drag.k": np.zeros(3)}, "linear_drag.k"),
        ({"friction": np.zeros(3, np.float32)}, "<f8"),
        ({"position": np.zeros((3, 2, 2))}, "rollout 0"),
        ({"friction": np.full(3, np.nan)}, "friction"),
        ({"friction": np.zeros(0)}, "friction"),
    ],
)
def test_invalid_arrays_are_rejected_by_name(tmp_path: Path, arrays: dict[str, Any], wanted: str) -> None:
    done = rollout(tmp_path, arrays=arrays)
    assert done.returncode == 2 and wanted in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert not (tmp_path / "out.npz").exists()


def test_the_graphics_processor_is_used_or_its_absence_explained(tmp_path: Path) -> None:
    done = rollout(tmp_path, "--engine", "gpu", arrays=inputs())
    if done.returncode:
        assert done.returncode == 2 and "graphics processor" in done.stderr and "lanes" in done.stderr, done.stderr
    else:
        with np.load(tmp_path / "out.npz") as out:
            assert json.loads(str(out["about"]))["engine"] == "gpu"


def test_arrays_are_shared_with_other_libraries_without_a_copy(tmp_path: Path) -> None:
    done = rollout(tmp_path, arrays=inputs())
    assert done.returncode == 0, done.stderr
    from_file = np.load(tmp_path / "out.npz")["position"]
    pytest.importorskip("msgpack")
    received = codec.unpack(codec.pack({"position": from_file}))["position"]
    for array in [from_file, received]:
        assert array.flags.writeable
        shared = np.from_dlpack(array)
        assert np.shares_memory(shared, array)
    torch = pytest.importorskip("torch")
    tensor = torch.from_dlpack(received)
    tensor[0, 0, 0, 0] = 7.0
    assert received[0, 0, 0, 0] == 7.0 and tensor.shape == from_file.shape


ARM: dict[str, Any] = {
    "format": "iplw.scene/2",
    "gravity": [0.0, -9.81],
    "time_step": 0.002,
    "steps": 200,
    "observe_every": 50,
    "bodies": [
        {"name": name, "shape": {"type": "box", "half_width": 0.02, "half_height": 0.2}, "mass": 0.5, "position": [0.0, y]}
        for name, y in (("upper", -0.2), ("lower", -0.6))
    ],
    "joints": [
        {"name": "shoulder", "kind": "revolute", "body": "upper", "anchor": [0.0, 0.0]},
        {"name": "elbow", "kind": "revolute", "body": "lower", "parent": "upper", "anchor": [0.0, -0.4]},
    ],
    "motors": [{"joint": "shoulder", "control": "torque", "max_torque": 2.0}],
}


def test_arrays_of_joints_have_the_bits_of_single_scenes(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    position, command = random.uniform(-1, 1, (5, 2)), random.uniform(-1, 1, (5, 4, 1))
    (tmp_path / "scene.json").write_text(json.dumps(ARM))
    np.savez(tmp_path / "in.npz", position=position, command=command)
    files = ["--scene", str(tmp_path / "scene.json"), "--in", str(tmp_path / "in.npz"), "--out", str(tmp_path / "out.npz")]
    subprocess.run([str(BINARY), "rollout", *files], check=True, capture_output=True)
    with np.load(tmp_path / "out.npz") as out:
        assert out["joints"].tolist() == ["shoulder", "elbow"] and out["position"].shape == (5, 5, 2)
        for i in range(5):
            scene = json.loads(json.dumps(ARM))
            for joint, start in zip(scene["joints"], position[i].tolist()):
                joint["position"] = start
            rows = "".join(f"{0.1 * k},{command[i, k, 0]!r}\n" for k in range(4)).replace("np.float64(", "").replace(")", "")
            (tmp_path / "commands.csv").write_text("t,shoulder.command\n" + rows)
            (tmp_path / "line.jsonl").write_text(json.dumps(scene) + "\n")
            single = [str(BINARY), "rollout", "--in", str(tmp_path / "line.jsonl"), "--commands", str(tmp_path / "commands.csv")]
            joints = json.loads(subprocess.run(single, check=True, capture_output=True, text=True).stdout)["joints"]
            for j, name in enumerate(("shoulder", "elbow")):
                assert np.allclose(out["position"][i, :, j], joints[name]["position"], atol=1e-12)
                assert np.allclose(out["velocity"][i, :, j], joints[name]["velocity"], atol=1e-11)


def test_wrong_shapes_of_joints_are_named(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(ARM))
    np.savez(tmp_path / "in.npz", position=np.zeros((5, 3)))
    files = ["--scene", str(tmp_path / "scene.json"), "--in", str(tmp_path / "in.npz"), "--out", str(tmp_path / "out.npz")]
    done = subprocess.run([str(BINARY), "rollout", *files], capture_output=True, text=True)
    assert done.returncode != 0 and "position" in done.stderr and "2 joints" in done.stderr
    assert not (tmp_path / "out.npz").exists()
