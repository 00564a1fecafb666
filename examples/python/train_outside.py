"""Train outside the server, act in the real world.

1. Estimate the latents of a real world from a few dozen counted interactions (`client.iplw`).
2. Roll out random actions on the training tasks, in batches: in a simulation with the default latents, and in
   one with the estimated ones.
3. Train a scikit-learn classifier on each: (observation, action) -> solved?
4. On every test task, execute actions in the real world: in random order, and in the order of each classifier's scores.

Prints a table of AUCCESS (1 means every task is solved at the first attempt). Bowling's default latents are
close to the true values, and the real world's drag, which no latent represents, biases an estimate from few trials: the
estimated latents do not necessarily score higher here.

    python examples/python/train_outside.py [--url http://127.0.0.1:8080] [--seed 0]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier
from threadpoolctl import threadpool_limits

import iplw

Array = NDArray[np.float64]
#: (observation, (n, dimension) actions) -> (n,) scores; actions with higher scores are executed first.
Score: TypeAlias = Callable[[Array, Array], Array]
#: Maximum number of attempts per task, as in AUCCESS.
ATTEMPTS = 100
#: Real attempts per request; a task ends with the first batch that solves it.
BATCH = 10


def main() -> None:
    options = arguments()
    clock = time.perf_counter()
    with iplw.Client(options.url, timeout=120) as client:
        train = client.task_ids("bowling", "train")[: options.tasks]
        test = client.task_ids("bowling", "test")[: options.tests]
        with client.create_world("bowling", kind="real", seed=options.seed) as real:
            latents = estimate(client, real, options)
            print(f"latents {latents} from {real.interactions} real interactions, {seconds(clock)}")
            rankings: dict[str, Score] = {"random": random_order}
            for name, selected in (("default", None), ("estimated", latents)):
                with client.create_world("bowling", kind="sim", latents=selected) as sim:
                    inputs, solved = simulate_actions(sim, train, options)
                rankings[name] = train_classifier(inputs, solved, options.seed)
                share = f"{solved.mean():.1%} solve"
                print(
                    f"trained on {len(solved) // 2} rollouts with {name} latents, {share}, {seconds(clock)}"
                )

            print(f"\n{'ranking':10} {'AUCCESS':>8} {'first':>6} {'in 10':>6} {'in 100':>7} {'attempts':>9}")
            for name, score in rankings.items():
                before = real.interactions
                solved_at = [attempts_to_solve(real, task, score, options.seed) for task in test]
                shares = [np.mean([k <= limit for k in solved_at]) for limit in (1, 10, ATTEMPTS)]
                used = real.interactions - before
                cells = f"{shares[0]:6.0%} {shares[1]:6.0%} {shares[2]:7.0%} {used:9}"
                print(f"{name:10} {auccess(solved_at):8.3f} {cells}")
    print(f"\n{len(test)} test tasks in the real world, {seconds(clock)} in all")


def estimate(client: iplw.Client, real: iplw.World, options: argparse.Namespace) -> dict[str, float] | None:
    """The identifiable latents; the others keep the simulation's defaults."""
    if options.rounds == 0:
        return None
    job = client.iplw("bowling", world=real, rounds=options.rounds, actions=10, seed=options.seed)
    rows = job.wait(progress=True)["latents"]
    return {row["name"]: round(row["value"], 3) for row in rows if row["identifiable"]}


def simulate_actions(
    sim: iplw.World, tasks: Sequence[str], options: argparse.Namespace
) -> tuple[Array, NDArray[np.bool_]]:
    """Random actions on each task: (2n, features) inputs and (2n,) outcomes."""
    rng = np.random.default_rng(options.seed)
    inputs, solved = [], []
    for task in tasks:
        observation, _ = sim.reset(task=task)
        # About a quarter of the actions are invalid; these are not simulated.
        actions = rng.random((options.actions, sim.dimension))
        results = sim.rollout(actions)
        placed, outcome = actions[results.valid], results.solved[results.valid]
        # The task is symmetric, so every rollout is used twice.
        inputs += [features(observation, placed), features(*mirror(observation, placed))]
        solved += [outcome, outcome]
    return np.concatenate(inputs), np.concatenate(solved)


def train_classifier(inputs: Array, solved: NDArray[np.bool_], seed: int) -> Score:
    """Scores of a classifier, summed over the input and its mirror image."""
    model = HistGradientBoostingClassifier(
        learning_rate=0.05, max_iter=200, max_leaf_nodes=8, class_weight="balanced", random_state=seed
    )
    model.fit(inputs, solved)

    def score(observation: Array, actions: Array) -> Array:
        observed = features(observation, actions), features(*mirror(observation, actions))
        probabilities: Array = sum(model.predict_proba(inputs)[:, 1] for inputs in observed)
        return probabilities

    return score


def random_order(observation: Array, actions: Array) -> Array:
    """Scores that keep the candidates' random order."""
    return -np.arange(len(actions), dtype=np.float64)


def attempts_to_solve(real: iplw.World, task: str, score: Score, seed: int) -> float:
    """Number of valid attempts until the task is solved, in order of score; infinity if none of the first 100 solves it."""
    observation, _ = real.reset(task=task)
    candidates = np.random.default_rng(seed).random((2000, real.dimension))
    candidates = candidates[np.argsort(-score(observation, candidates))]
    attempts = 0
    for start in range(0, len(candidates), BATCH):
        for result in real.rollout(candidates[start : start + BATCH]):
            attempts += result.valid
            if result.solved:
                return attempts
            if attempts == ATTEMPTS:
                return math.inf
    return math.inf


def features(observation: Array, actions: Array) -> Array:
    """(n, features): the balls, the action, and the action's position relative to each ball.

    Offsets in units of the radii generalise across tasks, unlike positions.
    """
    # Fractions of the scene's width: (x, y, radius) of green and blue, then of red from the action, whose
    # radius is between 2 and 32 of 256 pixels.
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


def mirror(observation: Array, actions: Array) -> tuple[Array, Array]:
    """The mirror image: green and blue are swapped."""
    balls, actions = observation.reshape(-1, 3)[::-1].copy(), actions.copy()
    balls[:, 0] = 1 - balls[:, 0]
    actions[:, 0] = 1 - actions[:, 0]
    return balls.ravel(), actions


def auccess(solved_at: Sequence[float]) -> float:
    """PHYRE's metric: the share of tasks solved within k attempts, averaged with weights ln(k+1) - ln(k)."""
    k = np.arange(1, ATTEMPTS + 1)
    weights = np.log(k + 1) - np.log(k)
    within = (np.asarray(solved_at)[:, None] <= k).mean(axis=0)
    return float((weights * within).sum() / weights.sum())


def seconds(since: float) -> str:
    return f"{time.perf_counter() - since:.0f} s"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="train outside the server, transfer to the real world")
    parser.add_argument("--url", help="address of a running server; default: a private one is started")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tasks", type=int, default=60, help="training tasks, at most 60")
    parser.add_argument("--actions", type=int, default=100, help="random actions per training task")
    parser.add_argument("--tests", type=int, default=20, help="test tasks, at most 20")
    parser.add_argument("--rounds", type=int, default=3, help="rounds of estimation; 0 uses the default latents")
    return parser.parse_args()


if __name__ == "__main__":
    # Small trees do not benefit from threads, and synchronisation is expensive on a loaded machine.
    with threadpool_limits(1):
        main()
