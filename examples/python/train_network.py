"""Deep Q-learning in one file, in the manner of CleanRL: trained in simulation, scored in a real world.

An episode has one step, so the value of an action is its chance to solve the task, and nothing needs to be bootstrapped:

1. `--worlds` simulated worlds are stepped together, a request a step (`iplw.make_vec`). In each, the best of some random
   actions is taken by the network's score, or, with a chance that falls, any of them.
2. What happened goes into a buffer; the network learns from as many successes as failures of it, after every step.
3. For every test task it ranks candidate actions, and a real world tries them in that order (`World.evaluate`): AUCCESS,
   the measure of the server's own policies, beside the policy `random`. Real attempts are counted.

The network is plain NumPy, since learning takes less time here than simulating; JAX with flax and optax would be 755 MB to
install. The server never sees it: whatever scores actions will do.

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
    """(n, 6) and (n, 3) of bowling -> (n, 21): the balls, the action, and how the red ball stands to either of them.

    Offsets in units of radii carry over from task to task, which positions alone do not.
    """
    balls = observations.reshape(-1, 2, 3)
    # Shares of the scene's width: its radius runs from 1/3 to 16/3 m of 42.67 m.
    radius = (2 + 30 * actions[:, 2]) / 256
    columns = [actions, observations]
    for k in (0, 1):
        dx, dy = actions[:, 0] - balls[:, k, 0], actions[:, 1] - balls[:, k, 1]
        reach = radius + balls[:, k, 2]
        gap = np.hypot(dx, dy) - reach
        columns += [dx / reach, dy, gap, radius / balls[:, k, 2], np.sign(dx) * (np.abs(dx) < reach)]
    columns += [actions[:, 0] - balls[:, :, 0].mean(axis=1), np.ptp(balls[:, :, 0], axis=1)]
    return np.column_stack([np.asarray(column).reshape(len(actions), -1) for column in columns])


def mirrored(observations: Array, actions: Array) -> tuple[Array, Array]:
    """The same seen in a mirror: green and blue change places."""
    balls, actions = observations.reshape(-1, 2, 3)[:, ::-1].copy(), actions.copy()
    balls[:, :, 0], actions[:, 0] = 1 - balls[:, :, 0], 1 - actions[:, 0]
    return balls.reshape(-1, 6), actions


class QNetwork:
    """Two hidden layers of rectified units; its output is the logit of the chance to solve the task."""

    def __init__(self, inputs: int, hidden: int, rng: np.random.Generator) -> None:
        sizes = [(inputs, hidden), (hidden, hidden), (hidden, 1)]
        self.weights = [rng.normal(0.0, np.sqrt(2.0 / n), (n, m)) for n, m in sizes]
        self.weights += [np.zeros(m) for _, m in sizes]
        self.moments = [(np.zeros_like(w), np.zeros_like(w)) for w in self.weights]
        self.updates = 0

    def values(self, observations: Array, actions: Array) -> Array:
        """(n,) scores, seen both ways round."""
        both = features(observations, actions), features(*mirrored(observations, actions))
        return self._pass(both[0])[-1][:, 0] + self._pass(both[1])[-1][:, 0]

    def learn(self, inputs: Array, solved: Array, rate: float) -> float:
        """One step of Adam on the binary cross-entropy of (n, inputs), (n,); gives it."""
        x, first, second, logit = self._pass(inputs)
        w2, w3 = self.weights[1], self.weights[2]
        down = (1.0 / (1.0 + np.exp(-logit)) - solved[:, None]) / len(solved)
        down2 = down @ w3.T * (second > 0)
        down1 = down2 @ w2.T * (first > 0)
        slopes = [x.T @ down1, first.T @ down2, second.T @ down]
        slopes += [d.sum(axis=0) for d in (down1, down2, down)]
        self.updates += 1
        for weight, slope, (mean, square) in zip(self.weights, slopes, self.moments, strict=True):
            mean += 0.1 * (slope - mean)
            square += 0.001 * (slope**2 - square)
            step = mean / (1 - 0.9**self.updates)
            weight -= rate * step / (np.sqrt(square / (1 - 0.999**self.updates)) + 1e-8)
        return float(np.mean(np.logaddexp(0.0, logit[:, 0]) - solved * logit[:, 0]))

    def _pass(self, x: Array) -> tuple[Array, Array, Array, Array]:
        w1, w2, w3, b1, b2, b3 = self.weights
        first = np.maximum(x @ w1 + b1, 0.0)
        second = np.maximum(first @ w2 + b2, 0.0)
        return x, first, second, second @ w3 + b3


class Buffer:
    """What happened: inputs of the network and whether the task was solved, each also as a mirror shows it."""

    def __init__(self) -> None:
        self.rows: dict[bool, list[Array]] = {True: [], False: []}

    def add(self, observations: Array, actions: Array, solved: NDArray[np.bool_]) -> None:
        """(n, 6), (n, 3), (n,)."""
        for inputs in (features(observations, actions), features(*mirrored(observations, actions))):
            for row, success in zip(inputs, solved, strict=True):
                self.rows[bool(success)].append(row)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Array, Array] | None:
        """(count, inputs) and (count,), half of them successes, or the rare ones would drown; None before there is one."""
        if not (self.rows[True] and self.rows[False]):
            return None
        half = count // 2
        selected = [self.rows[kind][i] for kind in (True, False) for i in rng.integers(len(self.rows[kind]), size=half)]
        return np.stack(selected), np.repeat([1.0, 0.0], half)


def train(client: iplw.Client, options: argparse.Namespace) -> QNetwork:
    """The loop: act in all worlds, remember, learn."""
    rng = np.random.default_rng(options.seed)
    network = QNetwork(21, options.hidden, rng)
    buffer, recent, clock = Buffer(), [], time.perf_counter()
    envs = iplw.make_vec("bowling", options.worlds, url=client.url, autoreset_mode="SameStep", split="train")
    try:
        observations, _ = envs.reset(seed=options.seed)
        for step in range(1, options.steps + 1):
            observed = np.asarray(observations, np.float64)
            explore = max(0.1, 1.0 - step / (0.5 * options.steps))
            actions = act(network, observed, explore, options.choices, rng)
            observations, _, _, _, infos = envs.step(actions.astype(np.float32))
            # An episode that ended with this step tells its end in `final_info`; the others acted in vain.
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
    network: QNetwork, observations: Array, explore: float, choices: int, rng: np.random.Generator
) -> Array:
    """(n, 3) actions: the best of some random ones for each world, or any with chance `explore`."""
    n = len(observations)
    attempted = rng.random((n, choices, 3))
    values = network.values(np.repeat(observations, choices, axis=0), attempted.reshape(-1, 3)).reshape(n, choices)
    best = np.where(rng.random(n) < explore, 0, values.argmax(axis=1))
    selected: Array = attempted[np.arange(n), best]
    return selected


def evaluate(client: iplw.Client, network: QNetwork, options: argparse.Namespace) -> None:
    """Has a real world try the network's ranking of every test task, and a random one."""
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
    print(f"\n{options.tests} test tasks in the real world, {time.perf_counter() - clock:.0f} s in all")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="deep Q-learning on the vector environment, scored in a real world")
    parser.add_argument("--url", help="address of a running server; none: a private one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=128, help="worlds that are stepped together")
    parser.add_argument("--steps", type=int, default=160, help="steps of all worlds")
    parser.add_argument("--choices", type=int, default=16, help="random actions of which the best is taken")
    parser.add_argument("--updates", type=int, default=16, help="updates of the network after a step")
    parser.add_argument("--batch", type=int, default=64, help="attempts an update learns from")
    parser.add_argument("--rate", type=float, default=2e-3, help="learning rate at the start; falls to 0")
    parser.add_argument("--hidden", type=int, default=64, help="units in each of two layers")
    parser.add_argument("--tests", type=int, default=20, help="test tasks, at most 20")
    return parser.parse_args()


if __name__ == "__main__":
    main()
