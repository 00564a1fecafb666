"""Parameter errors beside mujoco.sysid, on generated recordings of a pendulum with one hidden effect.

    cargo run --release --example joint_worlds -- 20 3001 pendulum out/worlds
    python benches/mujoco_sysid.py target/release/iplw out/worlds       needs `pip install "mujoco[sysid]" numpy`

mujoco.sysid fits four parameters to all trials, in parts of 1 s that start at measured states: viscous and dry friction, motor gain and
inertia. (Mass and centre of mass are held: the motion has only ratios to them.) iplw gets the scene and the recording, and decides what is missing. The error of a
parameter is relative to `UNITS`; parameters that iplw does not name have the values of the scene. In some worlds the hidden effect is one of
the four, in the others it is something that the fit cannot express.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray

#: Parameter -> its unit of error: N m s/rad, N m, 1, 1.
UNITS = {"b": 0.02, "friction": 0.1, "gain": 0.2, "inertia": 0.2}
NONE = {"b": 0.0, "friction": 0.0, "gain": 1.0, "inertia": 1.0}
#: Duration of the parts that mujoco.sysid fits, s.
WINDOW = 1.0
#: Effect -> its parameter among these, and the name there.
AMONG = {
    "viscous_friction": ("b", "b"),
    "coulomb_friction": ("friction", "torque"),
    "motor_gain": ("gain", "s"),
    "inertia_factor": ("inertia", "s"),
}


def model_text(scene: dict[str, Any]) -> str:
    """The pendulum as MJCF."""
    rod, motor = scene["bodies"][0], scene["motors"][0]
    half, width = rod["shape"]["half_height"], rod["shape"]["half_width"]
    inertia = rod["mass"] * (half**2 + width**2) / 3
    return (
        f'<mujoco><option gravity="0 -9.81 0" timestep="{scene["time_step"]}" integrator="RK4"><flag contact="disable"/></option><worldbody><body name="rod">'
        f'<joint name="hinge" axis="0 0 1"/><inertial pos="0 {-half} 0" mass="{rod["mass"]}" diaginertia="{inertia} {inertia} {inertia}"/>'
        f'<geom type="sphere" size="0.01"/></body></worldbody><actuator><motor name="motor" joint="hinge" ctrlrange="{-motor["max_torque"]} {motor["max_torque"]}"/>'
        '</actuator><sensor><jointpos name="position" joint="hinge"/></sensor></mujoco>'
    )


def read_trials(file: Path) -> list[NDArray[np.float64]]:
    """By trial: rows of time, position and command."""
    rows: dict[str, list[list[float]]] = {}
    with file.open() as text:
        for row in csv.DictReader(text):
            rows.setdefault(row["trial"], []).append([float(row[key]) for key in ("t", "hinge", "hinge.command")])
    return [np.array(own) for own in rows.values()]


def windows(trial: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Parts of a trial of `WINDOW` s: fitted whole, motions of 5 s have many local optima."""
    count = round((trial[-1, 0] - trial[0, 0]) / WINDOW)
    edges = np.linspace(0, len(trial) - 1, count + 1).round().astype(int)
    return [trial[a : b + 1] for a, b in zip(edges[:-1], edges[1:])]


def initial_state(rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and velocity at the first time, by a quadratic polynomial through the first observations."""
    fit = np.polynomial.polynomial.polyfit(rows[:11, 0] - rows[0, 0], rows[:11, 1], 2)
    return fit[:1], fit[1:2]


def by_sysid(scene: dict[str, Any], trials: list[NDArray[np.float64]]) -> dict[str, float]:
    """The four parameters, fitted by mujoco.sysid."""
    spec = mujoco.MjSpec.from_string(model_text(scene))
    model = spec.compile()
    inertia = float(model.body("rod").inertia[0])
    modifiers = {
        "b": lambda s, p: setattr(s.joint("hinge"), "damping", [p.value[0], 0, 0]),
        "friction": lambda s, p: setattr(s.joint("hinge"), "frictionloss", p.value[0]),
        "gain": lambda s, p: setattr(s.actuator("motor"), "gear", [p.value[0], 0, 0, 0, 0, 0]),
        "inertia": lambda s, p: setattr(s.body("rod"), "inertia", [p.value[0] * inertia] * 3),
    }
    bounds = {"b": (0.0, 0.5), "friction": (0.0, 0.5), "gain": (0.2, 2.0), "inertia": (0.2, 4.0)}
    parameters = sysid.ParameterDict()
    for name, modifier in modifiers.items():
        parameters.add(sysid.Parameter(name, nominal=NONE[name], min_value=bounds[name][0], max_value=bounds[name][1], modifier=modifier))
        parameters[name].value[:] = NONE[name] + (0.1 * UNITS[name] if bounds[name][0] == NONE[name] else 0.0)
    sequences = []
    for k, rows in enumerate(part for trial in trials for part in windows(trial)):
        start = sysid.create_initial_state(model, *initial_state(rows), np.zeros(0))
        rows = rows - [rows[0, 0], 0.0, 0.0]
        steps = np.arange(rows[0, 0], rows[-1, 0] + 1e-9, scene["time_step"])
        held = rows[np.searchsorted(rows[:, 0], steps + 1e-9) - 1, 2:3]
        # MuJoCo's sensors have the values before the step that the time counts already.
        measured = sysid.TimeSeries.from_names(rows[1:, 0] + scene["time_step"], rows[1:, 1:2], model)
        sequences.append(sysid.ModelSequences(f"trial {k}", spec, f"trial {k}", start, sysid.TimeSeries(steps, held), measured))
    residual = sysid.build_residual_fn(models_sequences=sequences)
    found, _ = sysid.optimize(initial_params=parameters, residual_fn=residual, optimizer="mujoco", verbose=False)
    return {name: float(found[name].value[0]) for name in NONE}


def by_iplw(program: str, scene: dict[str, Any], file: Path) -> tuple[dict[str, float], str]:
    """The same parameters of the most probable set of effects, and the verdict with the sets."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.json").write_text(json.dumps(scene))
        command = [program, "diagnose", "--scene", str(folder / "scene.json"), "--trials", str(file), "--out", str(folder / "report")]
        subprocess.run(command, check=True, capture_output=True)
        report = json.loads((folder / "report" / "report.json").read_text())
    out = dict(NONE)
    for effect in report["effects"]:
        if effect["name"] in AMONG:
            ours, theirs = AMONG[effect["name"]]
            out[ours] = next(p["value"] for p in effect["parameters"] if p["name"] == theirs)
    return out, f"{report['verdict']}: {' | '.join(' + '.join(own) for own in report['rivals'])}"


def error(found: dict[str, float], truth: dict[str, float]) -> float:
    """Root mean square of the errors of all four, in their units."""
    return float(np.sqrt(np.mean([((found[name] - truth[name]) / unit) ** 2 for name, unit in UNITS.items()])))


def main(program: str, folder: Path) -> None:
    print(f"MuJoCo {mujoco.__version__}\n\n| world | hidden | error of iplw | error of mujoco.sysid | iplw | seconds: iplw, sysid |\n|---|---|---|---|---|---|")
    errors: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for file in sorted(folder.glob("*.json")):
        world = json.loads(file.read_text())
        hidden, truth = world["truth"], dict(NONE)
        if hidden and hidden["name"] in ("payload", "centre_shift", "link_length"):
            # They change what the fit holds.
            continue
        is_among = hidden is None or hidden["name"] in AMONG
        if hidden and hidden["name"] in AMONG:
            ours, theirs = AMONG[hidden["name"]]
            truth[ours] = hidden["parameters"][theirs]
        start = time.perf_counter()
        own, verdict = by_iplw(program, world["scene"], file.with_suffix(".csv"))
        middle = time.perf_counter()
        peer = by_sysid(world["scene"], read_trials(file.with_suffix(".csv")))
        end = time.perf_counter()
        pair = (error(own, truth), error(peer, truth))
        errors[is_among].append(pair)
        name = hidden["name"] if hidden else "nothing"
        print(f"| {file.stem} | {name} | {pair[0]:.3f} | {pair[1]:.3f} | {verdict} | {middle - start:.0f}, {end - middle:.0f} |", flush=True)
    for is_among, pairs in errors.items():
        if pairs:
            own_mean, peer_mean = np.sqrt(np.mean(np.square(pairs), axis=0))
            kind = "the hidden effect is among the four, or there is none" if is_among else "an effect is missing from the four"
            print(f"\n{kind}: root mean square error {own_mean:.3f} (iplw), {peer_mean:.3f} (mujoco.sysid), {len(pairs)} worlds")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
