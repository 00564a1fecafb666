"""Environments as stable-baselines3 takes them: its `VecEnv`, stepped with one request for all.

    from stable_baselines3 import PPO
    from iplw.sb3 import make_vec_env

    model = PPO("MlpPolicy", make_vec_env("bowling", 256), n_steps=8)

Needs `pip install stable-baselines3`, which brings PyTorch; nothing else of this package does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from .vector import PlacementVectorEnv



class PlacementVecEnv(VecEnv):  # type: ignore[misc]
    """A `PlacementVectorEnv` as a `VecEnv`: an environment whose episode ends begins the next at once.

    The last observation of an episode that ended is its info's `terminal_observation`; nothing is ever truncated.
    Actions of components run from -1 to 1, if `symmetric`: what a policy's normal distribution around 0 can reach.
    """

    def __init__(self, envs: PlacementVectorEnv, *, symmetric: bool = True) -> None:
        if envs.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"envs has autoreset_mode {envs.metadata['autoreset_mode'].value!r}; allowed: 'SameStep'"
            )
        #: The environments as Gymnasium has them.
        self.envs = envs
        self.render_mode = envs.render_mode
        self._actions: NDArray[Any] | None = None
        actions = envs.single_action_space
        self._symmetric = symmetric and isinstance(actions, spaces.Box)
        if self._symmetric:
            actions = spaces.Box(-1.0, 1.0, actions.shape, np.float32)
        super().__init__(envs.num_envs, envs.single_observation_space, actions)

    def reset(self) -> NDArray[Any]:
        """(num_envs, ...) observations; by the seeds and options that `seed` and `set_options` left, once."""
        seeds = list(self._seeds) if any(seed is not None for seed in self._seeds) else None
        options = self._options[0] or None
        if any(other != self._options[0] for other in self._options):
            raise ValueError("options differ between environments; allowed: the same for all")
        observations, infos = self.envs.reset(seed=seeds, options=options)
        self.reset_infos = _each(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes the actions for `step_wait`."""
        self._actions = np.clip((actions + 1.0) / 2.0, 0.0, 1.0) if self._symmetric else actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, whether episodes ended, and an info for each environment."""
        assert self._actions is not None, "step_async first"
        observations, rewards, ended, _, infos = self.envs.step(self._actions)
        final, last = infos.pop("final_info", {}), infos.pop("final_obs", None)
        for key in ("_final_info", "_final_obs"):
            infos.pop(key, None)
        each, ends = _each(infos, self.num_envs), _each(final, self.num_envs)
        for i in np.flatnonzero(ended).tolist():
            self.reset_infos[i] = each[i]
            assert last is not None
            each[i] = {**ends[i], "terminal_observation": last[i], "TimeLimit.truncated": False}
        return observations, rewards.astype(np.float32), ended, each

    def close(self) -> None:
        """Deletes the worlds."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture of each environment."""
        return list(self.envs.render() or [None] * self.num_envs)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """What all of them have in common, for each of the indices."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets it for all; there is no setting it for some."""
        self._all(indices, f"set {attr_name} of")
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method of the vector, as `set_latents`, once for all."""
        self._all(indices, f"call {method_name} of")
        return [getattr(self.envs, method_name)(*args, **kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """No environment is wrapped by itself."""
        return [False] * len(list(self._get_indices(indices)))

    def _all(self, indices: None | int | Iterable[int], what: str) -> None:
        asked = sorted(self._get_indices(indices))
        if asked != list(range(self.num_envs)):
            raise ValueError(f"cannot {what} environments {asked}; allowed: all of them at once")


def make_vec_env(
    task: str = "bowling", num_envs: int = 1, *, symmetric: bool = True, **settings: Any
) -> PlacementVecEnv:
    """`iplw.PlacementVectorEnv` with these settings, as stable-baselines3 takes it."""
    envs = PlacementVectorEnv(num_envs, task, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    return PlacementVecEnv(envs, symmetric=symmetric)


def _each(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """A dictionary for each environment, of Gymnasium's dictionary of arrays and masks."""
    each: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, values in infos.items():
        if key.startswith("_"):
            continue
        for i in np.flatnonzero(infos[f"_{key}"]).tolist():
            value = values[i]
            each[i][key] = value.item() if isinstance(value, np.generic) else value
    return each
