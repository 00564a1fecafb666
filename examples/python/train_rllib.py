"""PPO of RLlib on many environments, a request a step; what it solves at first and at last.

Needs `pip install 'ray[rllib]' torch`.

    python examples/python/train_rllib.py [--url http://127.0.0.1:8080] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import ray
from ray.rllib.algorithms.ppo import PPOConfig


def main() -> None:
    options = arguments()
    ray.init(options.cluster, log_to_driver=False)
    # The prefix imports iplw in every process that makes environments. Without an address each has a server of its own.
    config = (
        PPOConfig()
        .environment("iplw:iplw/Bowling-v0", env_config={"url": options.url})
        .env_runners(
            num_env_runners=options.runners,
            num_envs_per_env_runner=options.envs,
            # One request for a step of all.
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=8,
        )
        # An episode has one step: there is nothing to discount.
        .training(gamma=0.0, lambda_=0.0, train_batch_size_per_learner=2048, minibatch_size=512, num_epochs=10, lr=3e-4)
        .debugging(seed=options.seed)
    )
    algorithm = config.build_algo()
    clock, steps, rewards = time.perf_counter(), 0, []
    for _ in range(options.iterations):
        result: dict[str, Any] = algorithm.train()["env_runners"]
        steps += result["num_env_steps_sampled"]
        rewards.append(result["episode_return_mean"])
    took = time.perf_counter() - clock
    print(f"{steps:.0f} steps in {took:.0f} s, {steps / took:.0f} steps/s")
    tenth = max(1, len(rewards) // 10)
    first, last = (sum(part) / tenth for part in (rewards[:tenth], rewards[-tenth:]))
    print(f"episodes solved, of those that ended: {first:.1%} at first, {last:.1%} at last")
    algorithm.stop()


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="PPO of RLlib on bowling")
    parser.add_argument("--url", help="address of a running server; none: a private one for each process")
    parser.add_argument("--cluster", default="local", help="address of a Ray cluster; `local` begins one here")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runners", type=int, default=0, help="processes that step environments; 0: this one")
    parser.add_argument("--envs", type=int, default=256, help="environments of each, stepped together")
    parser.add_argument("--iterations", type=int, default=100, help="iterations of some 2048 steps")
    return parser.parse_args()


if __name__ == "__main__":
    main()
