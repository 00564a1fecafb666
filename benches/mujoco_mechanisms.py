"""Mechanisms beside MuJoCo: agreement of motions, and rollout-steps per second on one core.

    python benches/mujoco_mechanisms.py target/release/iplw          needs `pip install mujoco numpy`

The same planar models as MJCF and as `iplw.scene/2`: bodies with the same inertia, torques that hold for 20 ms, no contacts or friction,
time step 2 ms, Runge-Kutta of order 4. MuJoCo's fastest integrator for these models, semi-implicit Euler, is timed as well; its errors are
larger. Rates are those of many rollouts minus those of few, so that starting a program does not count.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
from numpy.typing import NDArray

TIME_STEP, STEPS, HOLD = 0.002, 1000, 10
WIDTH = 0.02


@dataclass(frozen=True)
class Link:
    """A body on a joint; `at` is the joint and `centre` the centre of mass, m, in the configuration of the scene."""

    body: str
    kind: str
    at: tuple[float, float]
    centre: tuple[float, float]
    mass: float
    inertia: float
    max_torque: float | None
    parent: str | None = None


def rod(body: str, top: float, length: float, mass: float, max_torque: float | None, parent: str | None = None) -> Link:
    """A rod that hangs on a hinge at height `top`."""
    inertia = mass * length**2 / 12
    return Link(body, "revolute", (0.0, top), (0.0, top - length / 2), mass, inertia, max_torque, parent)


MODELS = {
    "pendulum": [rod("rod", 0.0, 0.5, 0.4, 1.0)],
    "double pendulum": [rod("upper", 0.0, 1.0, 1.0, None), rod("lower", -1.0, 1.0, 1.0, None, "upper")],
    "cart-pole": [
        Link("cart", "prismatic", (0.0, 0.0), (0.0, 0.0), 1.0, 0.02, 8.0),
        rod("pole", 0.0, 0.6, 0.2, None, "cart"),
    ],
    "two-link arm": [rod("upper", 0.0, 0.4, 0.6, 3.0), rod("lower", -0.4, 0.35, 0.4, 1.0, "upper")],
}


def scene(links: list[Link]) -> dict[str, Any]:
    """The model as a scene."""
    return {
        "format": "iplw.scene/2",
        "gravity": [0.0, -9.81],
        "time_step": TIME_STEP,
        "steps": STEPS,
        "observe_every": STEPS,
        "bodies": [
            {
                "name": link.body,
                "shape": {"type": "disc", "radius": WIDTH},
                "mass": link.mass,
                "inertia": link.inertia,
                "position": list(link.centre),
            }
            for link in links
        ],
        "joints": [
            {
                "name": f"{link.body}_joint",
                "kind": link.kind,
                "body": link.body,
                "anchor": list(link.at),
                **({"axis": [1.0, 0.0]} if link.kind == "prismatic" else {}),
                **({"parent": link.parent} if link.parent else {}),
            }
            for link in links
        ],
        "motors": [
            {"joint": f"{link.body}_joint", "control": "torque", "max_torque": link.max_torque}
            for link in links
            if link.max_torque is not None
        ],
    }


def mjcf(links: list[Link], integrator: str) -> str:
    """The model as MJCF, in the plane of x and y."""

    def body(index: int) -> str:
        link = links[index]
        base = links[index - 1].at if index else (0.0, 0.0)
        inside = body(index + 1) if index + 1 < len(links) else ""
        kind, axis = ("hinge", "0 0 1") if link.kind == "revolute" else ("slide", "1 0 0")
        centre = (link.centre[0] - link.at[0], link.centre[1] - link.at[1])
        return (
            f'<body name="{link.body}" pos="{link.at[0] - base[0]} {link.at[1] - base[1]} 0">'
            f'<joint name="{link.body}_joint" type="{kind}" axis="{axis}"/>'
            f'<inertial pos="{centre[0]} {centre[1]} 0" mass="{link.mass}" diaginertia="{link.inertia} {link.inertia} {link.inertia}"/>'
            f"{inside}</body>"
        )

    motors = "".join(
        f'<motor joint="{link.body}_joint" ctrlrange="{-link.max_torque} {link.max_torque}" ctrllimited="true"/>'
        for link in links
        if link.max_torque is not None
    )
    return (
        f'<mujoco><option gravity="0 -9.81 0" timestep="{TIME_STEP}" integrator="{integrator}">'
        '<flag contact="disable" constraint="disable" energy="disable"/></option>'
        f"<worldbody>{body(0)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def inputs(links: list[Link], count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Initial positions, and torques of each hold."""
    random = np.random.default_rng(1)
    limits = np.array([link.max_torque for link in links if link.max_torque is not None])
    commands = random.uniform(-0.8, 0.8, (count, STEPS // HOLD, len(limits))) * limits
    return random.uniform(-1.0, 1.0, (count, len(links))), commands


def in_mujoco(links: list[Link], integrator: str, count: int) -> tuple[NDArray[np.float64], float]:
    """Final positions, and the seconds that the rollouts took on one thread."""
    model = mujoco.MjModel.from_xml_string(mjcf(links, integrator))
    position, commands = inputs(links, count)
    state = np.zeros((count, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    state[:, 1 : 1 + len(links)] = position
    control = np.repeat(commands, HOLD, axis=1) if model.nu else None
    data = mujoco.MjData(model)
    start = time.perf_counter()
    states, _ = mujoco.rollout.rollout(model, [data], state, control, nstep=STEPS, skip_checks=False)
    seconds = time.perf_counter() - start
    return states[:, -1, 1 : 1 + len(links)], seconds


def in_iplw(program: str, links: list[Link], count: int) -> tuple[NDArray[np.float64], float]:
    """Final positions, and the seconds of the whole command on one thread."""
    position, commands = inputs(links, count)
    arrays = {"position": position, **({"command": commands} if commands.shape[2] else {})}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.json").write_text(json.dumps(scene(links)))
        np.savez(folder / "starts.npz", **arrays)
        files = ["--scene", str(folder / "scene.json"), "--in", str(folder / "starts.npz"), "--out", str(folder / "ends.npz")]
        start = time.perf_counter()
        subprocess.run([program, "rollout", "--threads", "1", "--no-samples", *files], check=True, capture_output=True)
        seconds = time.perf_counter() - start
        return np.load(folder / "ends.npz")["position"][:, -1], seconds


def rate(seconds: list[float], counts: list[int]) -> float:
    """Rollout-steps per second, from a large and a small number of rollouts."""
    return (counts[1] - counts[0]) * STEPS / (seconds[1] - seconds[0])


def main(program: str) -> None:
    print(f"MuJoCo {mujoco.__version__}, {STEPS} steps of {TIME_STEP} s\n")
    print("| model | largest difference of a position, rad or m | iplw, steps/s | MuJoCo RK4 | ratio | MuJoCo Euler | ratio |")
    print("|---|---|---|---|---|---|---|")
    for name, links in MODELS.items():
        ours, theirs = in_iplw(program, links, 64)[0], in_mujoco(links, "RK4", 64)[0]
        difference = np.abs(ours - theirs).max()
        few, many = [1000, 41_000], [100, 1100]
        own = max(rate([in_iplw(program, links, n)[1] for n in few], few) for _ in range(3))
        peer = {
            kind: max(rate([in_mujoco(links, kind, n)[1] for n in many], many) for _ in range(3)) for kind in ("RK4", "Euler")
        }
        cells = " | ".join(f"{peer[kind] / 1e6:.2f} M | {own / peer[kind]:.0f}" for kind in ("RK4", "Euler"))
        print(f"| {name} | {difference:.1e} | {own / 1e6:.1f} M | {cells} |")


if __name__ == "__main__":
    main(sys.argv[1])
