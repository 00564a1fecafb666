"""Deep Q-learning in one file, in the manner of CleanRL: trained in simulation, scored in a real world.

An episode has one step, so the value of an action is its probability of solving the task, and no bootstrapping is needed:

1. `--worlds` simulated worlds are stepped together, one request per step (`iplw.make_vec`). In each, the action with the
   highest value among some random ones is selected, or, with a decaying probability epsilon, a random one.
2. Transitions are stored in a replay buffer; after every step the network is trained on balanced batches of successes and
   failures.
3. For every test task the network ranks candidate actions, and a real world executes them in that order
   (`World.evaluate`). AUCCESS, the metric of the server's policies, is compared with that of the policy `random`. Real
   attempts are counted.

The network is implemented in NumPy, as training takes less time here than simulation, and JAX with flax and optax would take
755 MB to install. The server does not depend on it: any function that scores actions can be used.

    python examples/python/train_network.py [--url http://127.0.0.1:8080] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import iplw

Array = NDArray[np.float64]


def features(observations: Array, actions: Array) -> Array:
    """(n, 6) and (n, 3) of bowling -> (n, 21): the balls, the action, and the red ball's position relative to each of them.

    Offsets in units of radii generalise across tasks, unlike positions.
    """
    balls = observations.reshape(-1, 2, 3)
    # Fractions of the scene's width: the radius is between 1/3 and 16/3 m of 42.67 m.
    radius = (2 + 30 * actions[:, 2]) / 256
    columns = [actions, observations]
    for k in (0, 1):
        dx, dy = actions[:, 0] - balls[:, k, 0], actions[:, 1] - balls[:, k, 1]
        reach = radius + balls[:, k, 2]
        gap = np.hypot(dx, dy) - reach
        columns += [dx / reach, dy, gap, radius / balls[:, k, 2], np.sign(dx) * (np.abs(dx) < reach)]
    columns += [actions[:, 0] - balls[:, :, 0].mean(axis=1), np.ptp(balls[:, :, 0], axis=1)]
    return np.column_stack([np.asarray(column).reshape(len(actions), -1) for column in columns])


def mirror(observations: Array, actions: Array) -> tuple[Array, Array]:
    """The mirror image: green and blue are swapped."""
    balls, actions = observations.reshape(-1, 2, 3)[:, ::-1].copy(), actions.copy()
    balls[:, :, 0], actions[:, 0] = 1 - balls[:, :, 0], 1 - actions[:, 0]
    return balls.reshape(-1, 6), actions


class QNetwork:
    """Two hidden layers of rectified linear units; the output is the logit of the probability of solving the task."""

    def __init__(self, inputs: int, hidden: int, rng: np.random.Generator) -> None:
        sizes = [(inputs, hidden), (hidden, hidden), (hidden, 1)]
        self.weights = [rng.normal(0.0, np.sqrt(2.0 / n), (n, m)) for n, m in sizes]
        self.weights += [np.zeros(m) for _, m in sizes]
        self.moments = [(np.zeros_like(w), np.zeros_like(w)) for w in self.weights]
        self.updates = 0

    def values(self, observations: Array, actions: Array) -> Array:
        """(n,) values, summed over the input and its mirror image."""
        both = features(observations, actions), features(*mirror(observations, actions))
        return self._forward(both[0])[-1][:, 0] + self._forward(both[1])[-1][:, 0]

    def learn(self, inputs: Array, solved: Array, rate: float) -> float:
        """One Adam step on the binary cross-entropy of (n, inputs), (n,); returns the loss."""
        x, first, second, logit = self._forward(inputs)
        w2, w3 = self.weights[1], self.weights[2]
        delta = (1.0 / (1.0 + np.exp(-logit)) - solved[:, None]) / len(solved)
        delta2 = delta @ w3.T * (second > 0)
        delta1 = delta2 @ w2.T * (first > 0)
        gradients = [x.T @ delta1, first.T @ delta2, second.T @ delta]
        gradients += [d.sum(axis=0) for d in (delta1, delta2, delta)]
        self.updates += 1
        for weight, gradient, (mean, square) in zip(self.weights, gradients, self.moments, strict=True):
            mean += 0.1 * (gradient - mean)
            square += 0.001 * (gradient**2 - square)
            step = mean / (1 - 0.9**self.updates)
            weight -= rate * step / (np.sqrt(square / (1 - 0.999**self.updates)) + 1e-8)
        return float(np.mean(np.logaddexp(0.0, logit[:, 0]) - solved * logit[:, 0]))

    def _forward(self, x: Array) -> tuple[Array, Array, Array, Array]:
        w1, w2, w3, b1, b2, b3 = self.weights
        first = np.maximum(x @ w1 + b1, 0.0)
        second = np.maximum(first @ w2 + b2, 0.0)
        return x, first, second, second @ w3 + b3


class ReplayBuffer:
    """Network inputs and whether the task was solved, each with its mirror image."""

    def __init__(self) -> None:
        self.rows: dict[bool, list[Array]] = {True: [], False: []}

    def add(self, observations: Array, actions: Array, solved: NDArray[np.bool_]) -> None:
        """(n, 6), (n, 3), (n,)."""
        for inputs in (features(observations, actions), features(*mirror(observations, actions))):
            for row, success in zip(inputs, solved, strict=True):
                self.rows[bool(success)].append(row)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Array, Array] | None:
        """(count, inputs) and (count,), half of them successes, which are rare; None if either class is empty."""
        if not (self.rows[True] and self.rows[False]):
            return None
        half = count // 2
        selected = [self.rows[kind][i] for kind in (True, False) for i in rng.integers(len(self.rows[kind]), size=half)]
        return np.stack(selected), np.repeat([1.0, 0.0], half)


def train(client: iplw.Client, options: argparse.Namespace) -> QNetwork:
    """The training loop: act in all worlds, store transitions, update the network."""
    rng = np.random.default_rng(options.seed)
    network = QNetwork(21, options.hidden, rng)
    buffer, recent, clock = ReplayBuffer(), [], time.perf_counter()
    envs = iplw.make_vec("bowling", options.worlds, url=client.url, autoreset_mode="SameStep", split="train")
    try:
        observations, _ = envs.reset(seed=options.seed)
        for step in range(1, options.steps + 1):
            observed = np.asarray(observations, np.float64)
            epsilon = max(0.1, 1.0 - step / (0.5 * options.steps))
            actions = act(network, observed, epsilon, options.choices, rng)
            observations, _, _, _, infos = envs.step(actions.astype(np.float32))
            # Episodes that ended in this step are in `final_info`; the other actions were invalid.
            end = infos.get("final_info", {})
            valid = np.asarray(end.get("valid", np.zeros(options.worlds)), dtype=bool)
            solved = np.asarray(end.get("solved", np.zeros(options.worlds)), dtype=bool)
            buffer.add(observed[valid], actions[valid], solved[valid])
            recent.append(solved[valid].mean() if valid.any() else 0.0)
            loss = float("nan")
            for _ in range(options.updates):
                if (batch := buffer.sample(options.batch, rng)) is not None:
                    rate = options.rate * 0.5 * (1 + np.cos(np.pi * step / options.steps))
                    loss = network.learn(*batch, rate)
            if step % max(1, options.steps // 10) == 0:
                rate_of_steps = step * options.worlds / (time.perf_counter() - clock)
                share = np.mean(recent[-max(1, options.steps // 10) :])
                print(f"step {step:4} loss {loss:.3f} solved {share:6.1%} {rate_of_steps:7.0f} steps/s", flush=True)
    finally:
        envs.close()
    return network


def act(
    network: QNetwork, observations: Array, epsilon: float, choices: int, rng: np.random.Generator
) -> Array:
    """(n, 3) actions (epsilon-greedy): for each world the best of some random ones, or with probability `epsilon` a random one."""
    n = len(observations)
    candidates = rng.random((n, choices, 3))
    values = network.values(np.repeat(observations, choices, axis=0), candidates.reshape(-1, 3)).reshape(n, choices)
    best = np.where(rng.random(n) < epsilon, 0, values.argmax(axis=1))
    selected: Array = candidates[np.arange(n), best]
    return selected


def evaluate(client: iplw.Client, network: QNetwork, options: argparse.Namespace) -> None:
    """Evaluates the network's ranking of actions and a random one on every test task in a real world."""
    rng = np.random.default_rng(options.seed)
    with client.create_world("bowling", kind="real", seed=options.seed) as real:
        ranking: dict[str, Any] = {}
        for task in client.task_ids("bowling", "test")[: options.tests]:
            observation, _ = real.reset(task=task)
            candidates = rng.random((2000, real.dimension))
            values = network.values(np.repeat(observation[None], len(candidates), axis=0), candidates)
            ranking[task] = candidates[np.argsort(-values)[:400]]
        jobs = {"this network": real.evaluate(ranking), "random": client.policy("random").evaluate(real)}
        print(f"\n{'policy':14} {'AUCCESS':>8} {'first':>6} {'in 10':>6} {'attempts':>9}")
        for name, job in jobs.items():
            result = job.wait()
            within = result["solved_within"]
            cells = f"{within[0]:6.0%} {within[9]:6.0%} {result['interactions']:9}"
            print(f"{name:14} {result['auccess']:8.3f} {cells}")


def main() -> None:
    options = arguments()
    clock = time.perf_counter()
    with iplw.Client(options.url, timeout=120) as client:
        network = train(client, options)
        evaluate(client, network, options)
    print(f"\n{options.tests} test tasks in the real world, {time.perf_counter() - clock:.0f} s in total")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="deep Q-learning on the vector environment, scored in a real world")
    parser.add_argument("--url", help="address of a running server; default: a private one is started")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=128, help="worlds stepped together")
    parser.add_argument("--steps", type=int, default=160, help="steps of all worlds")
    parser.add_argument("--choices", type=int, default=16, help="random candidate actions per world")
    parser.add_argument("--updates", type=int, default=16, help="network updates per step")
    parser.add_argument("--batch", type=int, default=64, help="batch size")
    parser.add_argument("--rate", type=float, default=2e-3, help="initial learning rate, decayed to 0")
    parser.add_argument("--hidden", type=int, default=64, help="units in each of the two layers")
    parser.add_argument("--tests", type=int, default=20, help="test tasks, at most 20")
    return parser.parse_args()


if __name__ == "__main__":
    main()
