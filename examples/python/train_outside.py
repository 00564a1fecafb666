"""Learn outside the server, act in the real world.

1. Estimate the latent factors of a real world from a few dozen counted interactions (`client.iplw`).
2. Make a simulation with those latents and roll random actions out on the training tasks, in batches.
3. Train a scikit-learn classifier: (observation, action) -> solved?
4. On every test task, try actions in the real world in the classifier's order, and in random order.

Ends with a table of AUCCESS (1 is solving every task at the first attempt):

    python examples/python/train_outside.py [--url http://127.0.0.1:8080] [--seed 0]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier

import iplw

Array = NDArray[np.float64]
#: Most attempts at a task, as AUCCESS counts them.
ATTEMPTS = 100
#: Real attempts sent at once; a task is left as soon as a batch solved it.
BATCH = 10


def main() -> None:
    options = arguments()
    rng = np.random.default_rng(options.seed)
    clock = time.perf_counter()
    with iplw.Client(options.url, timeout=120) as client:
        train = client.task_ids("bowling", "train")[: options.tasks]
        test = client.task_ids("bowling", "test")[: options.tests]
        with client.create_world("bowling", kind="real", seed=options.seed) as real:
            latents = estimate(client, real, options)
            spent = real.interactions
            print(f"latents {latents} from {spent} real interactions, {time.perf_counter() - clock:.0f} s")

            with client.create_world("bowling", kind="sim", latents=latents) as sim:
                inputs, solved = practice(sim, train, options.actions, rng)
            seconds = time.perf_counter() - clock
            print(f"{len(solved) // 2} simulated rollouts, {solved.mean():.1%} solve, {seconds:.0f} s")
            model = HistGradientBoostingClassifier(
                learning_rate=0.05,
                max_iter=200,
                max_leaf_nodes=8,
                class_weight="balanced",
                random_state=options.seed,
            )
            model.fit(inputs, solved)

            def learned(observation: Array, actions: Array) -> Array:
                seen = features(observation, actions), features(*mirrored(observation, actions))
                scores: Array = sum(model.predict_proba(inputs)[:, 1] for inputs in seen)
                return scores

            def random(observation: Array, actions: Array) -> Array:
                return rng.random(len(actions))

            print(f"\n{'ranking':10} {'AUCCESS':>8} {'first':>6} {'in 10':>6} {'in 100':>7} {'attempts':>9}")
            for name, score in (("random", random), ("learned", learned)):
                before = real.interactions
                at = [attempt(real, task, score, rng) for task in test]
                within = [np.mean([k <= most for k in at]) for most in (1, 10, ATTEMPTS)]
                used = real.interactions - before
                shares = f"{within[0]:6.0%} {within[1]:6.0%} {within[2]:7.0%}"
                print(f"{name:10} {auccess(at):8.3f} {shares} {used:9}")
    print(f"\n{len(test)} test tasks in the real world, {time.perf_counter() - clock:.0f} s in all")


def estimate(client: iplw.Client, real: iplw.World, options: argparse.Namespace) -> dict[str, float] | None:
    """The latents the data identify; the others stay at the simulation's defaults."""
    if options.rounds == 0:
        return None
    job = client.iplw(
        "bowling", world=real, rounds=options.rounds, actions=10, samples=100, seed=options.seed
    )
    rows = job.wait(progress=True)["latents"]
    return {row["name"]: round(row["value"], 3) for row in rows if row["identifiable"]}


def practice(
    sim: iplw.World, tasks: Sequence[str], count: int, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Random valid actions on each task: (2n, features) inputs and (2n,) whether they solved it."""
    inputs, solved = [], []
    for task in tasks:
        observation, _ = sim.reset(task=task)
        # About a quarter of the actions cannot be placed; that costs no rollout.
        actions = rng.random((count, sim.dimension))
        results = sim.rollout(actions)
        placed, outcome = actions[results.valid], results.solved[results.valid]
        # Left and right are alike, so every rollout counts twice.
        inputs += [features(observation, placed), features(*mirrored(observation, placed))]
        solved += [outcome, outcome]
    return np.concatenate(inputs), np.concatenate(solved)


def attempt(
    real: iplw.World, task: str, score: Callable[[Array, Array], Array], rng: np.random.Generator
) -> float:
    """Which valid attempt solves the task, best score first; infinity if none of the first hundred does."""
    observation, _ = real.reset(task=task)
    candidates = rng.random((5000, real.dimension))
    candidates = candidates[np.argsort(-score(observation, candidates))]
    tried = 0
    for start in range(0, len(candidates), BATCH):
        for result in real.rollout(candidates[start : start + BATCH]):
            tried += result.valid
            if result.solved:
                return tried
            if tried == ATTEMPTS:
                return math.inf
    return math.inf


def features(observation: Array, actions: Array) -> Array:
    """(n, features): the balls, the action, and how the action stands to each ball.

    Offsets in units of the radii carry over from task to task, which positions alone do not.
    """
    # Shares of the scene's width: (x, y, radius) of green and blue, then of red from the action, whose
    # radius runs from 2 to 32 of 256 pixels.
    balls = observation.reshape(-1, 3)
    red = np.column_stack([actions[:, 0], actions[:, 1], (2 + 30 * actions[:, 2]) / 256])
    columns: list[Any] = [actions, np.broadcast_to(observation, (len(actions), observation.size))]
    for x, y, radius in balls:
        dx, dy, reach = red[:, 0] - x, red[:, 1] - y, red[:, 2] + radius
        columns += [
            dx / reach,
            dy,
            np.hypot(dx, dy) - reach,
            red[:, 2] / radius,
            np.sign(dx) * (abs(dx) < reach),
        ]
    middle = balls[:, 0].mean()
    columns += [red[:, 0] - middle, np.full(len(actions), np.ptp(balls[:, 0]))]
    return np.column_stack(columns)


def mirrored(observation: Array, actions: Array) -> tuple[Array, Array]:
    """The same seen in a mirror: green and blue change places."""
    balls, actions = observation.reshape(-1, 3)[::-1].copy(), actions.copy()
    balls[:, 0] = 1 - balls[:, 0]
    actions[:, 0] = 1 - actions[:, 0]
    return balls.ravel(), actions


def auccess(solved_at: Sequence[float]) -> float:
    """PHYRE's measure: weights ln(k+1) - ln(k) on the share of tasks solved within k attempts."""
    k = np.arange(1, ATTEMPTS + 1)
    weights = np.log(k + 1) - np.log(k)
    within = (np.asarray(solved_at)[:, None] <= k).mean(axis=0)
    return float((weights * within).sum() / weights.sum())


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="train outside the server, transfer to the real world")
    parser.add_argument("--url", help="address of a running server; none: a private one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tasks", type=int, default=60, help="training tasks, at most 60")
    parser.add_argument("--actions", type=int, default=40, help="random actions on each training task")
    parser.add_argument("--tests", type=int, default=20, help="test tasks, at most 20")
    parser.add_argument("--rounds", type=int, default=2, help="rounds of estimation; 0: the default latents")
    return parser.parse_args()


if __name__ == "__main__":
    main()
