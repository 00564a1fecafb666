"""stable-baselines3's PPO on episodes of up to ten attempts at one task, PHYRE's setting: AUCCESS on test tasks before and after.

The reward of solving at attempt k of n is 1 - ln k / ln(n + 1), so that the mean return of the episodes is AUCCESS.

    pip install iplw stable-baselines3 && python examples/python/train_ppo_attempts.py
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from iplw.sb3 import make_vec_env

ATTEMPTS = 10


def auccess(model: Any, task: str, episodes: int = 4) -> float:
    """Mean return of `episodes` episodes in each of 64 environments, with actions sampled from the policy."""
    envs = make_vec_env(task, 64, split="test", max_attempts=ATTEMPTS)
    envs.seed(0)
    observations, ended, total = envs.reset(), np.zeros(64, int), 0.0
    while (ended < episodes).any():
        observations, rewards, dones, _ = envs.step(model.predict(observations, deterministic=False)[0])
        # Environments that are ahead are not counted further.
        total += float(rewards[ended < episodes].sum())
        ended += dones
    envs.close()
    return total / (64 * episodes)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", default="basketball")
    parser.add_argument("--steps", type=int, default=100_000, help="attempts in all environments")
    options = parser.parse_args()
    torch.set_num_threads(1)  # Small networks are slower with more.
    envs = make_vec_env(options.task, 128, split="train", max_attempts=ATTEMPTS)
    model = PPO("MlpPolicy", envs, n_steps=16, batch_size=512, gamma=1.0, gae_lambda=1.0, ent_coef=1e-3, seed=0, device="cpu")
    before, started = auccess(model, options.task), time.perf_counter()
    model.learn(options.steps)
    elapsed = time.perf_counter() - started
    print(f"{options.steps} attempts in {elapsed:.0f} s, {options.steps / elapsed:.0f} a second")
    print(f"AUCCESS of {ATTEMPTS} attempts at test tasks: {before:.3f} before, {auccess(model, options.task):.3f} after")
    envs.close()


if __name__ == "__main__":
    main()
