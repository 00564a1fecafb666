"""The batched engine on a graphics processor beside one core and all cores of the same machine.

    python benches/gpu.py target/release/iplw [--rollouts 1048576] [--out FILE]

Rollouts of three discs in a box and of ten boxes that fall, without samples, as NumPy arrays: each engine's rollout-steps per second, the time
of the program's start, of loading the kernel and of reading the arrays included and also subtracted (the time for a few rollouts). Then a plan of
10,000 actions under 64 draws and an estimation at the paper's scale, and on the GPU alone outcomes of 100,000 actions in all bowling tasks. The arrays that the engines
write are compared to the bit. Without a device only the processor's rows are printed.
"""

import argparse
import json
import os
import random
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

#: Rollouts whose time is subtracted, and those of the processor's rows.
FEW, MANY = 64, 65_536
#: Largest change of each initial coordinate, m.
JITTER_M = 0.3
#: Lower left of the box, its size and the discs' radii, m: those of bowling.
BOX_M, RADII_M = 42.667, (1.9, 2.5, 2.0)


def wall(name: str, position: list[float], half_width: float, half_height: float) -> dict[str, Any]:
    shape = {"type": "box", "half_width": half_width, "half_height": half_height}
    return {"name": name, "shape": shape, "position": position, "friction": 1.0, "restitution": 1.0}


def scene(bodies: list[dict[str, Any]], statics: list[dict[str, Any]]) -> dict[str, Any]:
    """Ten seconds at the time step of bowling."""
    return {"format": "iplw.scene/1", "bodies": bodies, "statics": statics, "gravity": [0.0, -9.8], "time_step": 1 / 240, "steps": 2400, "observe_every": 240}


def three_discs() -> dict[str, Any]:
    """Three discs in a box, with the sizes of bowling."""
    half, surface = BOX_M / 2, {"density": 0.25, "friction": 0.5, "restitution": 0.2}
    places = zip("abc", RADII_M, ([8.0, 12.0], [32.0, 20.0], [20.0, 30.0]))
    bodies = [{"name": name, "shape": {"type": "disc", "radius": radius}, "position": position, **surface} for name, radius, position in places]
    walls = [("floor", [half, -0.5], half + 1, 0.5), ("ceiling", [half, BOX_M + 0.5], half + 1, 0.5), ("left", [-0.5, half], 0.5, half), ("right", [BOX_M + 0.5, half], 0.5, half)]
    return scene(bodies, [wall(*of) for of in walls])


def ten_boxes() -> dict[str, Any]:
    """Ten turned boxes that fall into a room."""
    draw, box = random.Random(1), {"type": "box", "half_width": 0.5, "half_height": 0.4}
    surface = {"density": 1.0, "friction": 0.7, "restitution": 0.2}
    bodies = [{"name": f"b{i}", "shape": box, "position": [-6.0 + 3 * (i % 5), 3.0 + 2 * (i // 5)], "angle": draw.uniform(-1, 1), **surface} for i in range(10)]
    return scene(bodies, [wall("floor", [0.0, -0.5], 12.0, 0.5), wall("left", [-10.5, 7.0], 0.5, 8.0), wall("right", [10.5, 7.0], 0.5, 8.0)])


def seconds(binary: str, *arguments: Any) -> float:
    """Wall time of a command."""
    start = time.perf_counter()
    done = subprocess.run([binary, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    return time.perf_counter() - start


def has_device(binary: str) -> bool:
    """Whether the program can use a graphics processor here; prints why not."""
    done = subprocess.run([binary, "rollout", "--engine", "gpu"], input="", capture_output=True, text=True)
    if done.returncode:
        print(done.stderr.strip())
    return done.returncode == 0


def rollouts(binary: str, name: str, scene: dict[str, Any], count: int, device: bool, folder: Path) -> list[dict[str, Any]]:
    """Rows of one scene; the outputs are compared."""
    position = np.array([body["position"] for body in scene["bodies"]], float)
    (folder / "scene.json").write_text(json.dumps(scene))

    def arrays(rollouts: int) -> Path:
        path = folder / f"{rollouts}.npz"
        jitter = np.random.default_rng(1).uniform(-JITTER_M, JITTER_M, (rollouts, *position.shape))
        np.savez(path, position=position + jitter)
        return path

    def command(engine: str, rollouts: int, threads: int) -> tuple[float, Path]:
        out = folder / f"{engine}-{rollouts}-{threads}.npz"
        arguments = ["--threads", threads, "--scene", folder / "scene.json", "--in", arrays(rollouts), "--out", out, "--no-samples"]
        return seconds(binary, "rollout", "--engine", engine, *arguments), out

    cores = os.cpu_count() or 1
    runs = [("lanes", min(MANY, count), 1), ("lanes", min(MANY * cores, count), cores)] + [("gpu", count, cores)] * device
    rows = []
    for engine, size, threads in runs:
        short, _ = command(engine, FEW, threads)
        whole, out = command(engine, size, threads)
        steps = size * scene["steps"]
        rows.append({"scene": name, "engine": engine, "threads": threads, "rollouts": size, "seconds": whole, "start_seconds": short,
                     "steps_per_second": steps / whole, "steps_per_second_without_start": steps / max(whole - short, 1e-9)})
        print(json.dumps(rows[-1]), flush=True)
        if engine == "gpu":
            same = command("lanes", size, cores)[1]
            with np.load(out) as ours, np.load(same) as wanted:
                differing = [key for key in wanted if key != "about" and ours[key].tobytes() != wanted[key].tobytes()]
            print(f"{name}: arrays that differ from the processor's: {differing or 'none'}")
    return rows


def tasks(binary: str, device: bool, folder: Path) -> list[dict[str, Any]]:
    """Rows of outcomes and a plan."""
    rows = []
    for engine in ["lanes"] + ["gpu"] * device:
        plan = seconds(binary, "plan", "--task", "bowling:003", "--prior", "--actions", 10_000, "--draws", 64, "--engine", engine, "--out", folder / f"plan-{engine}")
        rows.append({"work": "plan of 10,000 actions under 64 draws", "engine": engine, "seconds": plan})
        print(json.dumps(rows[-1]), flush=True)
        estimate = seconds(binary, "estimate", "--task", "bowling", "--real", "damping=0.8", "--strategy", "mixed", "--seed", 1, "--engine", engine, "--json")
        rows.append({"work": "estimation at the paper's scale", "engine": engine, "seconds": estimate})
        print(json.dumps(rows[-1]), flush=True)
        if engine == "gpu":
            outcomes = seconds(binary, "outcomes", "--task", "bowling", "--actions", 100_000, "--engine", engine, "--out", folder / "outcomes")
            rows.append({"work": "outcomes of 100,000 actions in all bowling tasks", "engine": engine, "seconds": outcomes})
            print(json.dumps(rows[-1]), flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary")
    parser.add_argument("--rollouts", type=int, default=1 << 20, help="rollouts of the device")
    parser.add_argument("--out", type=Path, help="file of the rows, JSON")
    given = parser.parse_args()
    device = has_device(given.binary)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, of in (("three discs", three_discs()), ("ten boxes that fall", ten_boxes())):
            rows += rollouts(given.binary, name, of, given.rollouts, device, Path(folder))
        rows += tasks(given.binary, device, Path(folder))
    if given.out:
        given.out.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
