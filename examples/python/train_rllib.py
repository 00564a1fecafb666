"""RLlib's PPO on vectorised environments, with one request per step; reports the success rate at the start and at the end.

Requires `pip install 'ray[rllib]' torch`.

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
    # The prefix imports iplw in every process that creates environments. Without an address each starts a private server.
    config = (
        PPOConfig()
        .environment("iplw:iplw/Bowling-v0", env_config={"url": options.url})
        .env_runners(
            num_env_runners=options.runners,
            num_envs_per_env_runner=options.envs,
            # One request steps all environments.
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=8,
        )
        # Episodes have one step, so there is no discounting.
        .training(gamma=0.0, lambda_=0.0, train_batch_size_per_learner=2048, minibatch_size=512, num_epochs=10, lr=3e-4)
        .debugging(seed=options.seed)
    )
    algorithm = config.build_algo()
    clock, steps, rewards = time.perf_counter(), 0, []
    for _ in range(options.iterations):
        result: dict[str, Any] = algorithm.train()["env_runners"]
        steps += result["num_env_steps_sampled"]
        rewards.append(result["episode_return_mean"])
    elapsed = time.perf_counter() - clock
    print(f"{steps:.0f} steps in {elapsed:.0f} s, {steps / elapsed:.0f} steps/s")
    tenth = max(1, len(rewards) // 10)
    first, last = (sum(part) / tenth for part in (rewards[:tenth], rewards[-tenth:]))
    print(f"success rate of completed episodes: {first:.1%} at the start, {last:.1%} at the end")
    algorithm.stop()


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="PPO of RLlib on bowling")
    parser.add_argument("--url", help="address of a running server; default: each process starts a private one")
    parser.add_argument("--cluster", default="local", help="address of a Ray cluster; `local` starts one on this machine")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runners", type=int, default=0, help="env runner processes; 0: this process only")
    parser.add_argument("--envs", type=int, default=256, help="environments per process, stepped together")
    parser.add_argument("--iterations", type=int, default=100, help="iterations of about 2048 steps")
    return parser.parse_args()


if __name__ == "__main__":
    main()
