"""The stable-baselines3 adapter compared with the vector environment. Its base class is a stub, because the real one requires
PyTorch."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import iplw


class VecEnv:
    """The part of stable-baselines3 2.x's `VecEnv` that the adapter uses."""

    def __init__(self, num_envs: int, observation_space: Any, action_space: Any) -> None:
        self.num_envs, self.observation_space, self.action_space = num_envs, observation_space, action_space
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._reset_seeds()
        self._reset_options()

    def seed(self, seed: int) -> None:
        self._seeds: list[int | None] = [seed + i for i in range(self.num_envs)]

    def _reset_seeds(self) -> None:
        self._seeds = [None for _ in range(self.num_envs)]

    def _reset_options(self) -> None:
        self._options: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]

    def _get_indices(self, indices: Any) -> Any:
        return range(self.num_envs) if indices is None else [indices] if isinstance(indices, int) else indices


@pytest.fixture
def sb3(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    for name in ("stable_baselines3", "stable_baselines3.common", "stable_baselines3.common.vec_env"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(sys.modules["stable_baselines3.common.vec_env"], "VecEnv", VecEnv, raising=False)
    monkeypatch.delitem(sys.modules, "iplw.sb3", raising=False)
    import iplw.sb3

    yield iplw.sb3
    sys.modules.pop("iplw.sb3")


def test_steps_match_vector_environment(sb3: Any) -> None:
    ours = sb3.make_vec_env("bowling", 4)
    theirs = iplw.make_vec("bowling", 4, autoreset_mode="SameStep")
    assert (ours.action_space.low == -1).all() and (ours.action_space.high == 1).all()
    ours.seed(3)
    assert np.array_equal(ours.reset(), theirs.reset(seed=3)[0])
    assert all(set(info) == {"task", "split"} for info in ours.reset_infos)
    theirs.action_space.seed(0)
    ends = 0
    for _ in range(8):
        actions = theirs.action_space.sample()
        # Halving and doubling are exact in float32.
        actions = np.round(actions * 256) / 256
        ours.step_async(2 * actions - 1)
        observations, rewards, dones, infos = ours.step_wait()
        expected, reward, ended, _, response = theirs.step(actions)
        assert np.array_equal(observations, expected) and np.array_equal(dones, ended)
        assert rewards.dtype == np.float32 and np.array_equal(rewards, reward)
        for i in range(4):
            if not ended[i]:
                assert infos[i]["valid"] is False and infos[i]["reason"] == response["reason"][i]
                continue
            ends += 1
            assert infos[i]["valid"] is True and infos[i]["TimeLimit.truncated"] is False
            assert np.array_equal(infos[i]["terminal_observation"], response["final_obs"][i])
            assert infos[i]["task"] == response["final_info"]["task"][i]
            assert ours.reset_infos[i] == {"task": response["task"][i], "split": "train"}
    assert ends > 4
    ours.env_method("set_latents", friction=0.1)
    assert all(world.latents["friction"] == 0.1 for world in map(ours.envs.world, range(4)))
    assert ours.env_is_wrapped(object, 2) == [False] and ours.get_attr("num_envs") == [4] * 4
    with pytest.raises(ValueError, match="allowed: all environments together"):
        ours.env_method("set_latents", indices=[1], friction=0.1)
    ours.close()
    theirs.close()


def test_discrete_actions(sb3: Any) -> None:
    ours = sb3.make_vec_env("bowling", 2, action="discrete", world="real")
    ours.reset()
    ours.step_async(np.array([0, 49_999]))
    assert ours.step_wait()[0].shape == (2, 6)
    ours.close()


def test_requires_same_step_autoreset(sb3: Any) -> None:
    envs = iplw.make_vec("bowling", 2)
    with pytest.raises(ValueError, match="autoreset_mode 'NextStep'; allowed: 'SameStep'"):
        sb3.PlacementVecEnv(envs)
    envs.close()
