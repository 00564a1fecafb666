"""stable-baselines3's PPO on vectorised environments, with one request per step; reports the success rate before and after.

Requires `pip install stable-baselines3`, which depends on PyTorch.

    python examples/python/train_sb3.py [--url http://127.0.0.1:8080] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
from stable_baselines3 import PPO

from iplw.sb3 import make_vec_env


def main() -> None:
    options = arguments()
    envs = make_vec_env("bowling", options.envs, url=options.url, split="train")
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=8,
        batch_size=512,
        # Episodes have one step, so there is no discounting.
        gamma=0.0,
        gae_lambda=0.0,
        ent_coef=1e-3,
        policy_kwargs={"log_std_init": -0.7},
        seed=options.seed,
        device="cpu",
    )
    before = success_rate(model, options)
    clock = time.perf_counter()
    model.learn(options.steps)
    elapsed = time.perf_counter() - clock
    print(f"{options.steps} steps of {options.envs} environments in {elapsed:.0f} s, {options.steps / elapsed:.0f} steps/s")
    print(f"success rate of first attempts at test tasks: {before:.1%} before, {success_rate(model, options):.1%} after")
    envs.close()


def success_rate(model: Any, options: argparse.Namespace) -> float:
    """Success rate of 2048 first attempts at test tasks, sampled from the policy; invalid placements count as failures."""
    envs = make_vec_env("bowling", 256, url=options.url, split="test")
    solved = []
    for k in range(8):
        envs.seed(1000 * k)
        actions, _ = model.predict(envs.reset(), deterministic=False)
        envs.step_async(actions)
        solved.append(envs.step_wait()[1].mean())
    envs.close()
    return float(np.mean(solved))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="PPO of stable-baselines3 on bowling")
    parser.add_argument("--url", help="address of a running server; default: a private one is started")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--envs", type=int, default=256, help="environments stepped together")
    parser.add_argument("--steps", type=int, default=400_000, help="total steps over all environments")
    return parser.parse_args()


if __name__ == "__main__":
    main()
