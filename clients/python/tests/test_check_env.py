"""Gymnasium's own checker, over every form of every environment, with warnings as errors."""

from __future__ import annotations

import warnings
from itertools import product

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

from iplw.families import FAMILIES

FORMS = list(
    product(
        FAMILIES,
        ["sim", "real"],
        ["features", "image"],
        ["box", "discrete"],
    )
)


@pytest.mark.parametrize(("name", "world", "observation", "action"), FORMS)
def test_check_env(name: str, world: str, observation: str, action: str) -> None:
    env = gymnasium.make(name, world=world, observation=observation, action=action, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
        # As users have it, wrapped; the checker then recommends the unwrapped one, which was checked above.
        warnings.filterwarnings("ignore", message=".*different from the unwrapped version")
        check_env(env, skip_render_check=True)
        env.close()
        env.close()


def test_make_imports_the_package_by_its_prefix() -> None:
    env = gymnasium.make("iplw:iplw/Bowling-v0")
    assert env.reset(seed=0)[0] in env.observation_space
    env.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasium_vectorises(mode: str) -> None:
    # In separate processes too: a forked child gets a server of its own and leaves ours alone.
    envs = gymnasium.make_vec("iplw/Bowling-v0", num_envs=2, vectorization_mode=mode, action="discrete")
    first, _ = envs.reset(seed=1)
    single = gymnasium.make("iplw/Bowling-v0", action="discrete")
    assert [(single.reset(seed=seed)[0] == first[k]).all() for k, seed in enumerate([1, 2])] == [True, True]
    single.close()
    _, rewards, _, truncated, _ = envs.step(envs.action_space.sample())
    assert rewards.shape == (2,) and not truncated.any()
    envs.close()
