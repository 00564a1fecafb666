"""Optuna fits friction and restitution to measured trials; the estimate of `Client.iplw` from the same trials is printed beside.

    pip install iplw optuna && python examples/python/tune_optuna.py
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import optuna

import iplw

TRUTH = {"friction": 0.35, "restitution": 0.65}
#: Distance that counts most, m: after a missed collision the paths have nothing more to do with each other.
CAP_M = 1.0


def misfit(world: iplw.World, trials: iplw.Trials) -> float:
    """Mean capped distance between measured and simulated centres, m."""
    distances = []
    for trial in trials:
        rollout = world.rollout([trial["action"]], task=trial["task"], trajectories=True)[0]
        for name, measured in trial["bodies"].items():
            path = np.column_stack([measured["x"], measured["y"]])
            n = min(len(path), len(rollout.bodies[name]))
            distances.append(np.linalg.norm(path[:n] - rollout.bodies[name][:n, :2], axis=1))
    return float(np.minimum(np.concatenate(distances), CAP_M).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--evaluations", type=int, default=200, help="points that Optuna tries")
    options = parser.parse_args()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with iplw.Client() as client, client.create_world("bowling") as sim:
        real = client.create_world("bowling", kind="real", latents=TRUTH, damping=1.0, noise=0.01, seed=2)
        started = time.perf_counter()
        job = client.iplw("bowling", world=real, rounds=2, actions=8, samples=80, seed=1)
        estimate, trials, iplw_s = job.wait(), job.trials(), time.perf_counter() - started

        def objective(trial: optuna.Trial) -> float:
            return misfit(sim.set_latents(**{name: trial.suggest_float(name, 0.0, 1.0) for name in TRUTH}), trials)

        study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=1, multivariate=True))
        study.optimize(objective, n_trials=options.evaluations)
        optuna_s = time.perf_counter() - started - iplw_s
        values = {row["name"]: row["value"] for row in estimate["latents"]}
        best = misfit(sim.set_latents(**values), trials)
    print(f"{'':12} {'truth':>8} {'optuna':>8} {'iplw':>8}")
    for name, truth in TRUTH.items():
        print(f"{name:12} {truth:8.4f} {study.best_params[name]:8.4f} {values[name]:8.4f}")
    print(f"{'misfit, m':21} {study.best_value:8.4f} {best:8.4f}\n{'time, s':21} {optuna_s:8.1f} {iplw_s:8.1f}")


if __name__ == "__main__":
    main()
