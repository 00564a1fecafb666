"""Gymnasium's `check_env` over all variants of all environments, with warnings as errors."""

from __future__ import annotations

import warnings
from itertools import product
from typing import Any

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

from iplw.families import FAMILIES

#: All variants of the paper's families; one of each other family.
FORMS = [
    *product(["iplw/Bowling-v0", "iplw/Basketball-v0"], ["sim", "real"], ["features", "image"], ["box", "discrete"]),
    *((name, "real", "features", "box") for name in list(FAMILIES)[2:]),
]


SCENE: dict[str, Any] = {
    "format": "iplw.scene/1",
    "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "position": [0, 1]}],
    "statics": [{"name": "floor", "shape": {"type": "segment", "from": [-2, 0], "to": [2, 0]}}],
    "steps": 120,
    "goal": {"type": "inside", "body": "ball", "region": [[-2, 0], [0, 0], [0, 1], [-2, 1]]},
    "action": {"components": [{"target": "ball", "set": "x", "low": -1, "high": 1}]},
}
OPTIONS: list[dict[str, Any]] = [
    {"split": "test"},
    {"task": "bowling:017"},
    {"observation": "image", "image_size": 256},
    {"url": "tcp://private"},
    {"world": {"latents": {"friction": 0.2}, "damping": 0.8, "engine": "rapier"}},
    {"world": {"kind": "real", "noise": 0.02, "seed": 3}},
    {"world": {"kind": "real", "sealed": True}, "action": "discrete"},
    {"max_attempts": 3},
    {"task": None, "world": {"scene": SCENE}},
]


@pytest.mark.parametrize(("name", "world", "observation", "action"), FORMS)
def test_check_env(name: str, world: str, observation: str, action: str) -> None:
    check(gymnasium.make(name, world=world, observation=observation, action=action, render_mode="rgb_array"))


@pytest.mark.parametrize("options", OPTIONS, ids=[" ".join(options) for options in OPTIONS])
def test_check_env_with_other_options(options: dict[str, Any]) -> None:
    check(gymnasium.make("iplw/Bowling-v0", render_mode="rgb_array", **options))


def check(env: gymnasium.Env[Any, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
        # Wrapped, as created by gymnasium.make; the checker then recommends the unwrapped one, checked above.
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version")
        check_env(env, skip_render_check=True)
        env.close()
        env.close()


def test_make_imports_package_by_prefix() -> None:
    env = gymnasium.make("iplw:iplw/Bowling-v0")
    assert env.reset(seed=0)[0] in env.observation_space
    env.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasium_vector_environments(mode: str) -> None:
    # In subprocesses, too: a forked child starts its own server.
    envs = gymnasium.make_vec("iplw/Bowling-v0", num_envs=2, vectorization_mode=mode, action="discrete")
    first, _ = envs.reset(seed=1)
    single = gymnasium.make("iplw/Bowling-v0", action="discrete")
    assert [(single.reset(seed=seed)[0] == first[k]).all() for k, seed in enumerate([1, 2])] == [True, True]
    single.close()
    _, rewards, _, truncated, _ = envs.step(envs.action_space.sample())
    assert rewards.shape == (2,) and not truncated.any()
    envs.close()
