"""PPO of stable-baselines3 on many environments, a request a step; what it solves before and after.

Needs `pip install stable-baselines3`, which brings PyTorch.

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
        # An episode has one step: there is nothing to discount.
        gamma=0.0,
        gae_lambda=0.0,
        ent_coef=1e-3,
        policy_kwargs={"log_std_init": -0.7},
        seed=options.seed,
        device="cpu",
    )
    before = success(model, options)
    clock = time.perf_counter()
    model.learn(options.steps)
    took = time.perf_counter() - clock
    print(f"{options.steps} steps of {options.envs} environments in {took:.0f} s, {options.steps / took:.0f} steps/s")
    print(f"first attempts at test tasks that solve them: {before:.1%} before, {success(model, options):.1%} after")
    envs.close()


def success(model: Any, options: argparse.Namespace) -> float:
    """Share of 2048 first attempts at test tasks, drawn from the policy, that solve them; what cannot be placed does not."""
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
    parser.add_argument("--url", help="address of a running server; none: a private one")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--envs", type=int, default=256, help="environments that are stepped together")
    parser.add_argument("--steps", type=int, default=400_000, help="steps of all environments together")
    return parser.parse_args()


if __name__ == "__main__":
    main()
