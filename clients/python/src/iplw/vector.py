"""Vector environment: one request for each step, for any number of environments.

    gymnasium.make_vec("iplw/Bowling-v0", num_envs=256, vectorization_mode="vector_entry_point")
    iplw.make_vec("bowling", 256, autoreset_mode="SameStep")

Observations, rewards and infos are bit-identical to `gymnasium.vector.SyncVectorEnv` over `PlacementEnv`, for any number of
servers: `iplw.make_vec("bowling", 256, url=["http://a:8080", "http://b:8080"])`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from . import browser, envs, requests
from .errors import IplwError
from .film import Film
from .sharding import ShardedWorlds
from .sync import Client, World

#: Autoreset mode -> wire name.
AUTORESET_NAMES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}
#: Keys of the info of each environment that acted, with their type in Gymnasium's vector infos.
_STEP_KEYS: dict[str, type] = {
    "valid": bool,
    "solved": bool,
    "attempt": int,
    "steps": int,
    "task": object,
    "collisions": int,
    "rolling_steps": int,
}
#: Optional keys of the info.
_OPTIONAL_STEP_KEYS = ("reason", "end")


class PlacementVectorEnv(envs.Reconnecting, VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """`num_envs` worlds on the server, stepped together; settings as for `PlacementEnv`.

    `url` may name several servers; each gets a contiguous block of environments. A `seed` in `world` (of the noise) is
    that of the first world; world i uses seed + i.

    `autoreset_mode`: the next step resets an environment whose episode has ended (`NEXT_STEP`), the same step does and
    returns `final_obs` and `final_info` (`SAME_STEP`), or the caller does with `reset(options={"reset_mask": mask})`
    (`DISABLED`). `reset` accepts one seed (environment i uses seed + i) or one for each; `options` may also have `task` and
    `split`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        task: str | None = "bowling",
        world: Literal["sim", "real"] | Mapping[str, Any] = "sim",
        *,
        url: str | Sequence[str | None] | None = None,
        observation: Literal["features", "image"] = "features",
        action: Literal["box", "discrete"] = "box",
        render_mode: str | None = None,
        split: str = "train",
        max_attempts: int | None = None,
        image_size: int = 64,
        timeout: float = 30.0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        EzPickle.__init__(self, **{name: value for name, value in locals().items() if name not in ("self", "__class__")})
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; allowed: 1 or more")
        envs.check_settings(observation, action, split, render_mode, image_size)
        mode = AutoresetMode(autoreset_mode)
        settings = envs.world_settings(task, world, max_attempts)
        self.num_envs = num_envs
        self.metadata = {**envs.PlacementEnv.metadata, "autoreset_mode": mode}
        self.render_mode = render_mode
        self._mode = mode
        self._image_size = image_size if observation == "image" else None
        self._split = split if envs.draws_tasks(settings) else None
        urls = [url] if url is None or isinstance(url, str) else list(url)
        self._shards = ShardedWorlds(urls, settings, num_envs, timeout, envs.collections(task, world))
        try:
            self._first = self._shards.world(0)
            #: Address of the page to open at the first reset; None afterwards.
            self._page_url = browser.page_url(self.client) if render_mode == "human" else None
            self.single_observation_space = envs.observation_space(self._first, self._image_size)
            self.single_action_space = envs.action_space(self._first, action)
            self.observation_space = batch_space(self.single_observation_space, num_envs)
            self.action_space = batch_space(self.single_action_space, num_envs)
        except BaseException:
            self._shards.close()
            raise
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._seeds: list[int | None] = [None] * num_envs
        self._never_reset = np.ones(num_envs, np.bool_)
        self._observations = np.zeros(self.observation_space.shape or (), self.observation_space.dtype)
        self._ended = np.zeros(num_envs, np.bool_)
        #: Environments that have made a step: `render` shows its final state.
        self._stepped = np.zeros(num_envs, np.bool_)
        self._pictures: dict[str, NDArray[np.uint8]] = {}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Starts episodes in all environments, or in those of `options["reset_mask"]`."""
        remaining = dict(options or {})
        mask = self._mask(remaining.pop("reset_mask", None))
        task, split = remaining.pop("task", None), remaining.pop("split", None)
        if remaining:
            raise ValueError(f"options has {sorted(remaining)}; allowed: reset_mask, split, task")
        task_seeds = self._task_seeds(mask, self._seeds_by_env(seed))
        if split is None and task is None:
            split = self._split
        if self._page_url is not None:
            browser.open_world(self._page_url, self._first.id)
            self._page_url = None
        all_envs = bool(mask.all())
        if not all_envs:
            self._check_consistent("reset")
        answer = self._shards.send(
            lambda shard: requests.reset_worlds(
                shard.worlds, task_seeds[shard.slice], task, split, None if all_envs else mask[shard.slice]
            )
        )
        if all_envs:
            self._shards.inconsistency = None
        self._never_reset &= ~mask
        self._stepped &= ~mask
        self._observations = np.where(
            self._rows(mask), self._observe(answer["observation"], answer["task"]), self._observations
        )
        self._ended &= ~mask
        infos: dict[str, Any] = {}
        _add_reset_infos(infos, mask, answer)
        return self._observations.copy(), infos

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Executes one action in each environment; an environment that is reset ignores its action."""
        valid_actions = self._validated(actions)
        split = None if self._mode is AutoresetMode.DISABLED else self._split
        self._check_consistent("step")
        answer = self._shards.send(
            lambda shard: requests.step_worlds(shard.worlds, valid_actions[shard.slice], AUTORESET_NAMES[self._mode], split),
            self._may_be_refused(valid_actions),
        )
        reset = np.asarray(answer["reset"], np.bool_)
        ended = np.asarray(answer["terminated"], np.bool_)
        truncated = np.asarray(answer["truncated"], np.bool_)
        acted = ~reset
        valid = np.asarray(answer["valid"], np.bool_)
        self._stepped |= acted & valid
        infos: dict[str, Any] = {}
        if self._mode is AutoresetMode.SAME_STEP:
            ends = ended | truncated
            _add_step_infos(infos, acted & ~ends, answer, answer["task"])
            if ends.any():
                self._finish(infos, ends, answer)
            reset = reset | ends
        else:
            _add_step_infos(infos, acted, answer, answer["task"])
        if reset.any():
            _add_reset_infos(infos, reset, answer)
            self._stepped &= ~reset
        self._ended = (ended | truncated) if self._mode is not AutoresetMode.SAME_STEP else self._ended
        self._observations = self._observe(answer["observation"], answer["task"])
        reward = np.asarray(answer["reward"], np.float64)
        return self._observations.copy(), reward, ended, truncated, infos

    def render(self) -> tuple[Any, ...] | None:
        """One image for each environment, as `PlacementEnv.render`; one request for each.

        None for `human`: the page shows the first environment.
        """
        if self.render_mode == "human":
            return None
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render() without a render mode; use gymnasium.make_vec(..., render_mode="rgb_array")'
            )
            return None
        return tuple(
            envs.picture(self._shards.world(i), envs.RENDER_SIZE, end=bool(over)) for i, over in enumerate(self._stepped)
        )

    @property
    def client(self) -> Client:
        """The connection to the first server."""
        return self._shards.shards[0].client

    @property
    def worlds(self) -> list[str]:
        """Ids of the environments' worlds, in order."""
        return self._shards.worlds

    def world(self, index: int) -> World:
        """The current world of environment `index`."""
        return self._shards.world(index).refresh()

    def film(self, index: int, *, width: int = envs.RENDER_SIZE, fps: int = envs.FPS) -> Film:
        """The film of the last step of environment `index`, as `PlacementEnv.film`, even after a reset."""
        return self._shards.world(index).film(width=width, fps=fps)

    def set_latents(self, **latents: float | Sequence[float] | NDArray[Any]) -> None:
        """Sets latent factors of all worlds, one value for all or one for each; one request for each world."""
        each = {name: np.broadcast_to(np.asarray(v, np.float64), self.num_envs) for name, v in latents.items()}
        for i in range(self.num_envs):
            self._shards.world(i).set_latents(**{name: float(values[i]) for name, values in each.items()})

    def close_extras(self, **_: Any) -> None:
        """Deletes the worlds and closes the connections."""
        self._shards.close()

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The environments' generators."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The environments' seeds."""
        return tuple(int(self._seeds[i] or 0) for i, _ in enumerate(self.np_random))

    def _generator(self, i: int | np.integer[Any]) -> np.random.Generator:
        made = self._generators[i]
        if made is None:
            made, self._seeds[i] = seeding.np_random()
            self._generators[i] = made
        return made

    def _task_seeds(self, mask: NDArray[np.bool_], seeds: Sequence[int | None]) -> list[int | None]:
        """Seeds that restart a world's sequence of tasks; None continues it. As in `PlacementEnv.reset`."""
        task_seeds: list[int | None] = [None] * self.num_envs
        for i in np.flatnonzero(mask):
            if (seed := seeds[int(i)]) is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(seed)
            if seed is not None or self._never_reset[i]:
                task_seeds[int(i)] = int(self._generator(i).integers(2**32))
        return task_seeds

    def _check_consistent(self, what: str) -> None:
        """Rejects the operation if some environments have acted and others have not."""
        if self._shards.inconsistency is not None:
            raise IplwError(
                f"cannot {what}: some environments have acted and others have not, because of: {self._shards.inconsistency}; "
                "reset all environments, or create new ones"
            )

    def _may_be_refused(self, actions: NDArray[Any]) -> NDArray[np.intp]:
        """Environments whose action the server may reject, as far as the client can tell."""
        doubt = self._ended & (self._mode is AutoresetMode.DISABLED)
        if actions.dtype.kind == "f":
            doubt = doubt | ((actions < 0) | (actions > 1)).any(axis=1)
        else:
            doubt = doubt | (actions < 0) | (actions >= self._first.actions)
        return np.flatnonzero(doubt)

    def _finish(self, infos: dict[str, Any], ends: NDArray[np.bool_], answer: Mapping[str, Any]) -> None:
        """Adds `final_obs` and `final_info` of environments that ended and were reset in the same step."""
        tasks = answer["final_task"]
        last = self._observe(answer["final_observation"], tasks)
        final = np.full(self.num_envs, None, dtype=object)
        # Assigned one by one: NumPy would broadcast a row over the cells.
        for i, row in zip(np.flatnonzero(ends).tolist(), last[ends]):
            final[i] = row
        infos["final_obs"], infos["_final_obs"] = final, ends.copy()
        inner: dict[str, Any] = {}
        _add_step_infos(inner, ends, answer, tasks)
        infos["final_info"], infos["_final_info"] = inner, ends.copy()

    def _observe(self, features: Any, tasks: Sequence[str | None]) -> NDArray[Any]:
        if self._image_size is None:
            return np.asarray(features, np.float64).astype(np.float32)
        pictures = np.zeros_like(self._observations)
        for i, task in enumerate(tasks):
            if task is not None:
                pictures[i] = self._picture(i, task)
        return pictures

    def _picture(self, i: int, task: str) -> NDArray[np.uint8]:
        # The image of a task is constant.
        if task not in self._pictures:
            self._pictures[task] = envs.picture(self._shards.world(i), self._image_size or 0, task=task)
        return self._pictures[task]

    def _rows(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The mask reshaped to broadcast over observations."""
        return mask.reshape((-1,) + (1,) * (self._observations.ndim - 1))

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError(f"options['reset_mask'] is {type(mask).__name__}; allowed: a NumPy array of bool")
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] has shape {mask.shape} and {mask.sum()} true; "
                f"allowed: shape ({self.num_envs},) with at least one true"
            )
        return mask

    def _seeds_by_env(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has length {len(seed)}; allowed: {self.num_envs}, one for each environment")
        return list(seed)

    def _validated(self, actions: Any) -> NDArray[Any]:
        """Checks shape, type and finiteness of the actions; the server checks bounds."""
        array = np.asarray(actions)
        discrete = isinstance(self.single_action_space, spaces.Discrete)
        kind = np.integer if discrete else np.number
        if array.shape != self.action_space.shape or not np.issubdtype(array.dtype, kind):
            raise ValueError(
                f"actions have shape {array.shape} of {array.dtype}; "
                f"allowed: {self.action_space.shape} of {self.action_space.dtype}"
            )
        if not discrete and not np.isfinite(array).all():
            row = int(np.argmin(np.isfinite(array).all(axis=1)))
            raise ValueError(f"actions[{row}] is {array[row]}; allowed: finite numbers from 0 to 1")
        return array if discrete else np.asarray(array, array.dtype if array.dtype.kind == "f" else np.float64)


def make_vec(task: str = "bowling", num_envs: int = 1, **settings: Any) -> PlacementVectorEnv:
    """A vector environment of a family (`bowling`), a task (`bowling:017`) or a registered id (`iplw/Bowling-v0`).

    Further settings as for `PlacementVectorEnv`.
    """
    if task not in gymnasium.registry:
        return PlacementVectorEnv(num_envs, task, **settings)
    made = gymnasium.make_vec(task, num_envs, "vector_entry_point", **settings)
    assert isinstance(made, PlacementVectorEnv)
    return made


def _add_reset_infos(infos: dict[str, Any], mask: NDArray[np.bool_], answer: Mapping[str, Any]) -> None:
    """Adds infos of a reset for the environments in the mask."""
    for key in ("task", "split"):
        _add(infos, key, mask, answer[key], object)


def _add_step_infos(
    infos: dict[str, Any], mask: NDArray[np.bool_], answer: Mapping[str, Any], tasks: Sequence[Any]
) -> None:
    """Adds infos of a step for the environments in the mask."""
    if not mask.any():
        return
    for key, kind in _STEP_KEYS.items():
        _add(infos, key, mask, tasks if key == "task" else answer[key], kind)
    for key in _OPTIONAL_STEP_KEYS:
        has_value = np.array([value is not None for value in answer[key]], np.bool_) & mask
        if has_value.any():
            _add(infos, key, has_value, answer[key], object)


def _add(infos: dict[str, Any], key: str, mask: NDArray[np.bool_], values: Any, kind: type) -> None:
    """Adds one key as Gymnasium's vector environments do: an array and its mask."""
    array = infos.get(key)
    if array is None:
        array = np.full(len(mask), None, object) if kind is object else np.zeros(len(mask), kind)
        infos[key], infos[f"_{key}"] = array, np.zeros(len(mask), np.bool_)
    if kind is object:
        array[mask] = _objects(values)[mask]
    else:
        array[mask] = np.asarray(values)[mask]
    infos[f"_{key}"] |= mask


def _objects(values: Any) -> NDArray[np.object_]:
    """An object array with one value in each cell."""
    cells = np.empty(len(values), object)
    cells[:] = values
    return cells
