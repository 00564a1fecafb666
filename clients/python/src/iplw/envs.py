"""Gymnasium environments in which an action places a body and a simulation follows: reward 1 if the goal is reached.

    gymnasium.make("iplw/Bowling-v0", world="real", observation="image", action="discrete")

An episode ends (`terminated`) with its first valid action. An invalid action does not end it; `info["valid"]` is False and
`info["reason"]` gives the reason.

With `max_attempts` above 1, PHYRE's setting, an episode continues with the same task until an action reaches the goal or all
attempts have failed. The reward of solving at attempt k of at most n is the AUCCESS of the episode, 1 - ln k / ln(n + 1), so that
the mean return over tasks is PHYRE's AUCCESS for n = 100. Episodes are never truncated: the number of attempts is part of the task.

Each environment has its own world on the server and deletes it on `close()`. A copy, by `pickle` or `copy.deepcopy`, connects anew
and has a world of its own with the same settings; it starts with `reset`, as Gymnasium's `EzPickle` has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from inspect import signature
from typing import Any, Literal, TypeAlias

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.core import RenderFrame
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from . import browser, png
from .families import COLLECTIONS
from .film import Film
from .sync import Client, ControlWorld, World
from .rollout import Action, Rollouts

Observation: TypeAlias = NDArray[Any]

#: Width and height of `render()`, and width of films, px.
RENDER_SIZE = 256
#: Frame rate of films, 1/s.
FPS = 30
#: Frame rate of pictures that `render()` returns one by one, 1/s: an episode has two.
STILLS_FPS = 1
#: Minimum and maximum size of an image observation, px.
IMAGE_SIZES = (64, 256)


class Reconnecting(EzPickle):
    """An environment that is pickled and copied by its settings and spec; a copy connects anew.

    The subclass calls `EzPickle.__init__` with all settings.
    """

    spec: EnvSpec | None

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "spec": self.spec}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self.spec = state["spec"]


class WorldOwner(Reconnecting):
    """An environment with a connection and a world of its own."""

    client: Client
    world: World | ControlWorld
    _closed = False

    def close(self) -> None:
        """Deletes the world and closes the connection; idempotent."""
        if self._closed:
            return
        self._closed = True
        try:
            self.world.close()
        finally:
            self.client.close()


class PlacementEnv(WorldOwner, gymnasium.Env[Observation, Any]):
    """A Gymnasium environment with one world.

    - `task`: a family (`bowling`), one task of it (`bowling:017`), or None with a `scene` in `world`.
    - `world`: `sim`, `real`, or the settings of `Client.create_world` (`{"kind": "sim", "damping": 0.8}`).
    - `url`: the server's address; None for a private server.
    - `observation`: `features`, float32 in [0, 1]; or `image`, uint8 (image_size, image_size, 3) of the scene
      before the action.
    - `action`: `box`, float32 in [0, 1]; or `discrete`, an index.
    - `render_mode`: `rgb_array`: the scene before the action, and its final state after it; `rgb_array_list`: all frames since
      the last call, with the motion between; `human`: opens the web page at this world when the first episode starts.
    - `max_attempts`: valid attempts in an episode; see the head of this module.
    - `split`: `reset` samples a task from it; `reset(options={"split": ..., "task": ...})` overrides it.
    """

    # No automatic reset: the value that vector environments expect.
    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array", "rgb_array_list", "human"],
        # `FPS` for `rgb_array_list`.
        "render_fps": STILLS_FPS,
        "autoreset_mode": gymnasium.vector.AutoresetMode.DISABLED,
    }
    _spec: EnvSpec | None = None

    def __init__(
        self,
        task: str | None = "bowling",
        world: Literal["sim", "real"] | Mapping[str, Any] = "sim",
        *,
        url: str | None = None,
        observation: Literal["features", "image"] = "features",
        action: Literal["box", "discrete"] = "box",
        render_mode: str | None = None,
        split: str = "train",
        max_attempts: int | None = None,
        image_size: int = 64,
        timeout: float = 30.0,
    ) -> None:
        EzPickle.__init__(self, **{name: value for name, value in locals().items() if name not in ("self", "__class__")})
        check_settings(observation, action, split, render_mode, image_size, self.metadata["render_modes"])
        settings = world_settings(task, world, max_attempts)
        self.render_mode = render_mode
        if render_mode == "rgb_array_list":
            self.metadata = {**self.metadata, "render_fps": FPS}
        self._split = split
        self._image_size = image_size if observation == "image" else None
        self._never_reset = True
        #: The connection, used by this environment only.
        self.client = Client(url, timeout=timeout, collections=collections(task, world))
        try:
            #: Address of the page to open at the first reset; None afterwards.
            self._page_url = browser.page_url(self.client) if render_mode == "human" else None
            #: The environment's world.
            self.world: World = self.client.create_world(**settings)
            self.observation_space = observation_space(self.world, self._image_size)
            self.action_space = action_space(self.world, action)
        except BaseException:
            self.client.close()
            raise
        self._draws_tasks = draws_tasks(settings)
        self._noisy = bool(settings.get("noise"))
        self._picture_cache: tuple[str, NDArray[np.uint8]] | None = None
        self._ended = False
        #: Films of the steps since the last `render()`, and whether the episode has been rendered, for `rgb_array_list`.
        self._films: list[Film] = []
        self._rendered = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode on a task sampled from the split."""
        super().reset(seed=seed)
        remaining = dict(options or {})
        task, split = remaining.pop("task", None), remaining.pop("split", None)
        if remaining:
            raise ValueError(f"options has {sorted(remaining)}; allowed: task, split")
        if split is None and task is None and self._draws_tasks:
            split = self._split
        # A seed restarts the world's sequence of tasks; without one it continues.
        draw = int(self.np_random.integers(2**32)) if seed is not None or self._never_reset else None
        self._never_reset = False
        if self._page_url is not None:
            browser.open_world(self._page_url, self.world.id)
            self._page_url = None
        features, info = self.world.reset(seed=draw, task=task, split=split)
        self._ended = False
        self._films, self._rendered = [], False
        return self._observe(features, info), _episode_info(info)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Executes the action and simulates to the end."""
        features, reward, terminated, truncated, info = self.world.step(action)
        self._ended = self._ended or bool(info["valid"])
        if info["valid"] and self.render_mode == "rgb_array_list":
            self._films.append(self.film())
        return self._observe(features, info), reward, terminated, truncated, _episode_info(info)

    def render(self) -> RenderFrame | list[RenderFrame] | None:
        """(256, 256, 3) the scene before the action, or its final state after it; None for `human`.

        For `rgb_array_list` the frames since the last call: the scene, or the film of the step. Gymnasium's `save_video` writes them.
        """
        if self.render_mode == "human":
            return None
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render() without a render mode; use gymnasium.make(..., render_mode="rgb_array")'
            )
            return None
        if self.render_mode == "rgb_array_list":
            return self._new_frames()
        return picture(self.world, RENDER_SIZE, end=self._ended)

    def film(self, *, width: int = RENDER_SIZE, fps: int = FPS) -> Film:
        """The film of the last valid step, as observed; it costs no interaction.

        It remains available after a reset, until the next valid action. `Problem` (409) if there was no step.
        """
        return self.world.film(width=width, fps=fps)

    @property
    def spec(self) -> EnvSpec | None:
        """The spec. `nondeterministic` if the world has noise, which does not depend on the seed of an episode."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec and replace(spec, nondeterministic=spec.nondeterministic or self._noisy)

    def set_latents(self, **latents: float) -> dict[str, float] | None:
        """Sets density, friction or restitution; returns all latents. `Problem` in a sealed world."""
        return self.world.set_latents(**latents).latents

    def rollout(
        self, actions: Sequence[Action] | NDArray[Any], *, task: str | None = None, trajectories: bool = False
    ) -> Rollouts:
        """Simulates many actions on the current task (or `task`); the episode is unchanged."""
        return self.world.rollout(actions, task=task, trajectories=trajectories)

    def _new_frames(self) -> list[RenderFrame]:
        """The frames since the last call."""
        films, self._films = self._films, []
        first, self._rendered = not self._rendered, True
        if films and not first:
            gymnasium.logger.warn(
                "render() at every step returns the motion in parts, and gymnasium.wrappers.RecordVideo keeps only the last frame of "
                "each; iplw.RecordVideo records all frames"
            )
        if first and not films:
            return [picture(self.world, RENDER_SIZE)]
        return [_square(frame, RENDER_SIZE) for film in films for frame in film]

    def _observe(self, features: NDArray[np.float64], info: Mapping[str, Any]) -> Observation:
        if self._image_size is None:
            return features.astype(np.float32)
        # The image of a task is constant.
        task = str(info["task"])
        if self._picture_cache is None or self._picture_cache[0] != task:
            self._picture_cache = (task, picture(self.world, self._image_size))
        return np.array(self._picture_cache[1])


def check_settings(
    observation: str,
    action: str,
    split: str,
    render_mode: str | None,
    image_size: int,
    render_modes: Sequence[str] = ("rgb_array", "human"),
) -> None:
    """Rejects invalid settings."""
    _one_of("observation", observation, ("features", "image"))
    _one_of("action", action, ("box", "discrete"))
    _one_of("split", split, ("train", "validation", "test"))
    _one_of("render_mode", render_mode, (None, *render_modes))
    if not IMAGE_SIZES[0] <= image_size <= IMAGE_SIZES[1]:
        raise ValueError(f"image_size is {image_size}; allowed: {IMAGE_SIZES[0]} to {IMAGE_SIZES[1]}")


def collections(task: str | None, world: str | Mapping[str, Any]) -> tuple[str, ...]:
    """The collections that a private server must load for a task."""
    named = (task if isinstance(world, str) else world.get("task", task)) or ""
    own = COLLECTIONS.get(named.partition(":")[0])
    return () if own is None else (own,)


def draws_tasks(settings: Mapping[str, Any]) -> bool:
    """Whether tasks are sampled from a split: not for a custom scene or a single task."""
    return "scene" not in settings and ":" not in settings.get("task", "")


def observation_space(world: World, image_size: int | None) -> spaces.Box:
    """The observation space of a world: features, or images of this size."""
    if image_size is not None:
        return spaces.Box(0, 255, (image_size, image_size, 3), np.uint8)
    space = world.data["observation_space"]
    low, high = (np.asarray(space[key], dtype=np.float32) for key in ("low", "high"))
    return spaces.Box(low, high, dtype=np.float32)


def action_space(world: World, form: str) -> spaces.Box | spaces.Discrete:
    """The action space of a world, `box` or `discrete`."""
    if form == "discrete":
        return spaces.Discrete(world.actions)
    return spaces.Box(0.0, 1.0, (world.dimension,), np.float32)


def picture(world: World, size: int, *, end: bool = False, task: str | None = None) -> NDArray[np.uint8]:
    """(size, size, 3) image of the scene of the current or a given task, or of the final state of the last step."""
    view = "end" if end else "scene"
    return _square(png.decode(world.render(view=view, width=size, task=task)), size)


def world_settings(task: str | None, world: str | Mapping[str, Any], max_attempts: int | None = None) -> dict[str, Any]:
    """Arguments of `Client.create_world` from the arguments of an environment."""
    more = {} if max_attempts is None else {"max_attempts": max_attempts}
    if isinstance(world, Mapping):
        known = [name for name in signature(Client.create_world).parameters if name != "self"]
        if unknown := sorted(set(world) - set(known)):
            raise ValueError(f"world has {unknown}; allowed: {', '.join(known)}")
        settings = {**world, **more}
        if "scene" not in settings and task is not None:
            settings.setdefault("task", task)
        return settings
    _one_of("world", world, ("sim", "real"))
    return {"task": task, "kind": world, **more}


def _episode_info(info: Mapping[str, Any]) -> dict[str, Any]:
    """The info without counters that outlast the episode, so that equal episodes have equal infos."""
    return {key: value for key, value in info.items() if key not in ("interactions", "episode")}


def _square(picture: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """The image, cropped or padded with white to (size, size, 3)."""
    if picture.shape == (size, size, 3):
        return picture
    square = np.full((size, size, 3), 255, dtype=np.uint8)
    part = picture[:size, :size]
    square[: part.shape[0], : part.shape[1]] = part
    return square


def _one_of(name: str, value: object, allowed: Sequence[object]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} is {value!r}; allowed: {', '.join(map(repr, allowed))}")
