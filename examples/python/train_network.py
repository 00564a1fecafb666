"""A policy network of one's own: trained on the vector environment, transferred, scored by the server's AUCCESS.

1. Act at random in many simulated worlds at once (`iplw.make_vec`), one request for a step of all of them.
2. Train a small network on what happened: (observation, action) -> solved? It is plain numpy here; any framework that
   gives a score for an action will do, since the server never sees the network.
3. Let it rank candidate actions of every test task, send the ranking to a real world, and have it tried there
   (`World.evaluate`): the same protocol and the same measure as for the server's own policies, which stand beside it.

    python examples/python/train_network.py [--url http://127.0.0.1:8080] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from train_outside import features, mirrored, seconds

import iplw

Array = NDArray[np.float64]


class Network:
    """Two hidden layers of rectified units; its output is the logit of success."""

    def __init__(self, inputs: int, hidden: int, rng: np.random.Generator) -> None:
        sizes = [(inputs, hidden), (hidden, hidden), (hidden, 1)]
        self.layers = [rng.normal(0.0, np.sqrt(2.0 / n), (n, m)) for n, m in sizes]
        self.layers += [np.zeros(m) for _, m in sizes]
        self.moments = [(np.zeros_like(w), np.zeros_like(w)) for w in self.layers]
        self.updates = 0

    def __call__(self, x: Array) -> Array:
        """(n, inputs) -> (n,) logits."""
        return self._pass(x)[-1][:, 0]

    def learn(self, x: Array, y: Array, rate: float) -> None:
        """One step of Adam on the binary cross-entropy of (n, inputs), (n,)."""
        x, first, second, logit = self._pass(x)
        w2, w3 = self.layers[1], self.layers[2]
        down = (1.0 / (1.0 + np.exp(-logit)) - y[:, None]) / len(y)
        down2 = down @ w3.T * (second > 0)
        down1 = down2 @ w2.T * (first > 0)
        slopes = [x.T @ down1, first.T @ down2, second.T @ down]
        slopes += [d.sum(axis=0) for d in (down1, down2, down)]
        self.updates += 1
        for weight, slope, (mean, square) in zip(self.layers, slopes, self.moments, strict=True):
            mean += 0.1 * (slope - mean)
            square += 0.001 * (slope**2 - square)
            step = mean / (1 - 0.9**self.updates)
            weight -= rate * step / (np.sqrt(square / (1 - 0.999**self.updates)) + 1e-8)

    def _pass(self, x: Array) -> tuple[Array, Array, Array, Array]:
        w1, w2, w3, b1, b2, b3 = self.layers
        first = np.maximum(x @ w1 + b1, 0.0)
        second = np.maximum(first @ w2 + b2, 0.0)
        return x, first, second, second @ w3 + b3


def main() -> None:
    options = arguments()
    clock = time.perf_counter()
    rng = np.random.default_rng(options.seed)
    with iplw.Client(options.url, timeout=120) as client:
        inputs, solved = practice(client, options, rng)
        print(f"{len(solved) // 2} attempts in simulation, {solved.mean():.1%} solve, {seconds(clock)}")
        middle, width = inputs.mean(axis=0), inputs.std(axis=0) + 1e-9
        network = Network(inputs.shape[1], 64, rng)
        yes, no = np.flatnonzero(solved), np.flatnonzero(~solved)
        if not len(yes):
            raise SystemExit("nothing solved a task: there is nothing to learn from; give more --steps")
        for batch in range(options.batches):
            # As many successes as failures, or the rare ones would drown.
            rows = np.concatenate([rng.choice(yes, 32), rng.choice(no, 32)])
            rate = 1e-3 * (1 + np.cos(np.pi * batch / options.batches))
            network.learn((inputs[rows] - middle) / width, solved[rows].astype(float), rate)
        print(f"trained for {options.batches} batches, {seconds(clock)}")

        with client.create_world("bowling", kind="real", seed=options.seed) as real:
            ranking: dict[str, Any] = {}
            for task in client.task_ids("bowling", "test")[: options.tests]:
                observation, _ = real.reset(task=task)
                candidates = rng.random((2000, real.dimension))
                both = features(observation, candidates), features(*mirrored(observation, candidates))
                score = sum(network((part - middle) / width) for part in both)
                ranking[task] = candidates[np.argsort(-score)[:400]]
            jobs = {"this network": real.evaluate(ranking), "random": client.policy("random").evaluate(real)}
            print(f"\n{'policy':14} {'AUCCESS':>8} {'first':>6} {'in 10':>6} {'attempts':>9}")
            for name, job in jobs.items():
                found = job.wait(progress=True)
                within = found["solved_within"]
                cells = f"{within[0]:6.0%} {within[9]:6.0%} {found['interactions']:9}"
                print(f"{name:14} {found['auccess']:8.3f} {cells}")
    print(f"\n{len(ranking)} test tasks in the real world, {seconds(clock)} in all")


def practice(
    client: iplw.Client, options: argparse.Namespace, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Random actions in `--worlds` worlds at once: (2n, features) inputs and (2n,) whether they solved their task."""
    inputs, solved = [], []
    env = iplw.make_vec("bowling", options.worlds, url=client.url, autoreset_mode="SameStep", split="train")
    try:
        observations, _ = env.reset(seed=options.seed)
        for _ in range(options.steps):
            actions = rng.random((options.worlds, 3))
            following, _, _, _, infos = env.step(actions.astype(np.float32))
            # An episode that ended with this step tells its end in `final_info`; the others acted in vain.
            ends = infos.get("final_info", {})
            valid = np.asarray(ends.get("valid", np.zeros(options.worlds)), dtype=bool)
            outcome = np.asarray(ends.get("solved", np.zeros(options.worlds)), dtype=bool)
            for i in np.flatnonzero(valid):
                seen, action = np.asarray(observations[i], dtype=float), actions[i : i + 1]
                inputs += [features(seen, action), features(*mirrored(seen, action))]
                solved += [outcome[i], outcome[i]]
            observations = following
    finally:
        env.close()
    return np.concatenate(inputs), np.asarray(solved)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="train a network on the vector environment, transfer it")
    parser.add_argument("--url", help="address of a running server; none: a private one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=128, help="worlds that are stepped together")
    parser.add_argument("--steps", type=int, default=160, help="steps of all worlds")
    parser.add_argument("--batches", type=int, default=3000, help="updates of the network")
    parser.add_argument("--tests", type=int, default=20, help="test tasks, at most 20")
    return parser.parse_args()


if __name__ == "__main__":
    main()
