"""Environments for stable-baselines3: a `VecEnv` that steps all worlds with one request.

    from stable_baselines3 import PPO
    from iplw.sb3 import make_vec_env

    model = PPO("MlpPolicy", make_vec_env("bowling", 256), n_steps=8)

Requires `pip install stable-baselines3`, which installs PyTorch.
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
    """A `PlacementVectorEnv` as a `VecEnv`, with automatic reset in the same step.

    The last observation of an episode is `terminal_observation` in its info. If `symmetric`,
    action components range from -1 to 1, the range that a Gaussian policy centred at 0 covers.
    """

    def __init__(self, envs: PlacementVectorEnv, *, symmetric: bool = True) -> None:
        if envs.metadata["autoreset_mode"] is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"envs has autoreset_mode {envs.metadata['autoreset_mode'].value!r}; allowed: 'SameStep'"
            )
        #: The Gymnasium vector environment.
        self.envs = envs
        self.render_mode = envs.render_mode
        self._actions: NDArray[Any] | None = None
        actions = envs.single_action_space
        self._symmetric = symmetric and isinstance(actions, spaces.Box)
        if self._symmetric:
            actions = spaces.Box(-1.0, 1.0, actions.shape, np.float32)
        super().__init__(envs.num_envs, envs.single_observation_space, actions)

    def reset(self) -> NDArray[Any]:
        """(num_envs, ...) observations; uses the seeds and options set by `seed` and `set_options` once."""
        seeds = list(self._seeds) if any(seed is not None for seed in self._seeds) else None
        options = self._options[0] or None
        if any(other != self._options[0] for other in self._options):
            raise ValueError("options differ between environments; allowed: the same for all")
        observations, infos = self.envs.reset(seed=seeds, options=options)
        self.reset_infos = _infos_by_env(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Stores the actions for `step_wait`."""
        self._actions = np.clip((actions + 1.0) / 2.0, 0.0, 1.0) if self._symmetric else actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, dones and infos."""
        assert self._actions is not None, "call step_async first"
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        ended = terminated | truncated
        final_infos, final_obs = infos.pop("final_info", {}), infos.pop("final_obs", None)
        for key in ("_final_info", "_final_obs"):
            infos.pop(key, None)
        per_env, ends = _infos_by_env(infos, self.num_envs), _infos_by_env(final_infos, self.num_envs)
        for i in np.flatnonzero(ended).tolist():
            self.reset_infos[i] = per_env[i]
            assert final_obs is not None
            per_env[i] = {**ends[i], "terminal_observation": final_obs[i], "TimeLimit.truncated": bool(truncated[i])}
        return observations, rewards.astype(np.float32), ended, per_env

    def close(self) -> None:
        """Deletes the worlds."""
        self.envs.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One image for each environment."""
        return list(self.envs.render() or [None] * self.num_envs)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of the vector environment, once for each index."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute for all environments; a subset is not supported."""
        self._require_all(indices, f"set {attr_name} of")
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method of the vector environment, such as `set_latents`, once for all."""
        self._require_all(indices, f"call {method_name} of")
        return [getattr(self.envs, method_name)(*args, **kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Environments are never wrapped individually."""
        return [False] * len(list(self._get_indices(indices)))

    def _require_all(self, indices: None | int | Iterable[int], action: str) -> None:
        selected = sorted(self._get_indices(indices))
        if selected != list(range(self.num_envs)):
            raise ValueError(f"cannot {action} environments {selected}; allowed: all environments together")


def make_vec_env(
    task: str = "bowling", num_envs: int = 1, *, symmetric: bool = True, **settings: Any
) -> PlacementVecEnv:
    """Creates a `PlacementVecEnv` with the settings of `iplw.PlacementVectorEnv`."""
    envs = PlacementVectorEnv(num_envs, task, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    return PlacementVecEnv(envs, symmetric=symmetric)


def _infos_by_env(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Converts Gymnasium's dictionary of arrays and masks to one dictionary for each environment."""
    per_env: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, values in infos.items():
        if key.startswith("_"):
            continue
        for i in np.flatnonzero(infos[f"_{key}"]).tolist():
            value = values[i]
            per_env[i][key] = value.item() if isinstance(value, np.generic) else value
    return per_env
