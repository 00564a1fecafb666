"""Gymnasium environments: one placement, one rollout, solved or not.

    gymnasium.make("iplw/Bowling-v0", world="real", observation="image", action="discrete")

An episode is one attempt. A valid action ends it (`terminated`); one that cannot be placed leaves it open,
with `info["valid"]` False and `info["reason"]`. Nothing ever truncates.

Each environment has a world of its own on the server and deletes it on `close()`.
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
from numpy.typing import NDArray

from . import png, window
from .film import Film
from .sync import Client, World
from .rollout import Action, Rollouts

Observation: TypeAlias = NDArray[Any]

#: Pixels on a side of what `render()` returns; the width of films.
RENDER_SIZE = 256
#: Frames a second of films.
FPS = 30
#: Least and most pixels on a side of an image observation.
IMAGE_SIZES = (64, 256)


class PlacementEnv(gymnasium.Env[Observation, Any]):
    """One world as a Gymnasium environment.

    - `task`: a family (`bowling`), one task of it (`bowling:017`), or None with a `scene` in `world`.
    - `world`: `sim`, `real`, or the settings of `Client.create_world` (`{"kind": "sim", "damping": 0.8}`).
    - `url`: the server's address; None for a private server.
    - `observation`: `features`, float32 in [0, 1]; or `image`, uint8 (image_size, image_size, 3) of the scene
      before the action.
    - `action`: `box`, float32 in [0, 1]; or `discrete`, an index.
    - `render_mode`: `rgb_array`, the scene as it was before the action, or after it as it ended (`film()` has all that was
      in between); or `human`, which opens the server's page at this world when the first episode begins.
    - `split`: what `reset` draws tasks from; `reset(options={"split": ..., "task": ...})` overrides it.
    """

    # The environment never resets itself, which is what "disabled" means to a vector of them.
    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array", "human"],
        # Of films: an episode has one step, so that `render()` shows two moments of it.
        "render_fps": FPS,
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
        image_size: int = 64,
        timeout: float = 30.0,
    ) -> None:
        check(observation, action, split, render_mode, image_size)
        settings = settings_of(task, world)
        self.render_mode = render_mode
        self._split = split
        self._image_size = image_size if observation == "image" else None
        self._closed = False
        self._fresh = True
        #: The connection, shared with nobody.
        self.client = Client(url, timeout=timeout)
        try:
            #: The page that is to be opened; None once it was, or if nobody wants to look on.
            self._page = window.page(self.client) if render_mode == "human" else None
            #: This environment's own world.
            self.world: World = self.client.create_world(**settings)
            self.observation_space = observations(self.world, self._image_size)
            self.action_space = actions(self.world, action)
        except BaseException:
            self.client.close()
            raise
        self._drawn = is_drawn(settings)
        self._noisy = bool(settings.get("noise"))
        self._shown: tuple[str, NDArray[np.uint8]] | None = None
        self._ended = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode on a task drawn from the split."""
        super().reset(seed=seed)
        chosen = dict(options or {})
        task, split = chosen.pop("task", None), chosen.pop("split", None)
        if chosen:
            raise ValueError(f"options has {sorted(chosen)}; allowed: task, split")
        if split is None and task is None and self._drawn:
            split = self._split
        # A seed starts the world's own sequence of tasks anew; without one it goes on.
        draw = int(self.np_random.integers(2**32)) if seed is not None or self._fresh else None
        self._fresh = False
        if self._page is not None:
            window.show(self._page, self.world.id)
            self._page = None
        features, info = self.world.reset(seed=draw, task=task, split=split)
        self._ended = False
        return self._observe(features, info), _plain(info)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carries the action out and rolls the world out."""
        features, reward, terminated, truncated, info = self.world.step(action)
        self._ended = self._ended or bool(info["valid"])
        return self._observe(features, info), reward, terminated, truncated, _plain(info)

    def render(self) -> RenderFrame | list[RenderFrame] | None:
        """(256, 256, 3) the scene before the action, or after it how it ended; None for `human`: the page shows it."""
        if self.render_mode == "human":
            return None
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render() without a render mode; use gymnasium.make(..., render_mode="rgb_array")'
            )
            return None
        return picture(self.world, RENDER_SIZE, end=self._ended)

    def film(self, *, width: int = RENDER_SIZE, fps: int = FPS) -> Film:
        """The step that was made last, frame by frame, as it was observed: no further interaction, whatever the world.

        It is kept through a reset, until the next valid action. Where there was none, a `Problem` (409).
        """
        return self.world.film(width=width, fps=fps)

    def close(self) -> None:
        """Deletes the world and lets the server go; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            self.world.close()
        finally:
            self.client.close()

    @property
    def spec(self) -> EnvSpec | None:
        """How it was made. `nondeterministic` where the world has noise, which goes on whatever an episode's seed."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec and replace(spec, nondeterministic=spec.nondeterministic or self._noisy)

    def set_latents(self, **latents: float) -> dict[str, float] | None:
        """Sets some of density, friction, restitution; gives all of them. A sealed world raises `Problem`."""
        return self.world.set_latents(**latents).latents

    def rollout(
        self, actions: Sequence[Action] | NDArray[Any], *, task: str | None = None, trajectories: bool = False
    ) -> Rollouts:
        """Many actions on the current task (or `task`) at once; the episode stays as it is."""
        return self.world.rollout(actions, task=task, trajectories=trajectories)

    def _observe(self, features: NDArray[np.float64], info: Mapping[str, Any]) -> Observation:
        if self._image_size is None:
            return features.astype(np.float32)
        # The task's scene does not change, so neither does its picture.
        task = str(info["task"])
        if self._shown is None or self._shown[0] != task:
            self._shown = (task, picture(self.world, self._image_size))
        return np.array(self._shown[1])


def check(observation: str, action: str, split: str, render_mode: str | None, image_size: int) -> None:
    """Refuses settings that are not allowed, by name."""
    _one_of("observation", observation, ("features", "image"))
    _one_of("action", action, ("box", "discrete"))
    _one_of("split", split, ("train", "validation", "test"))
    _one_of("render_mode", render_mode, (None, *PlacementEnv.metadata["render_modes"]))
    if not IMAGE_SIZES[0] <= image_size <= IMAGE_SIZES[1]:
        raise ValueError(f"image_size is {image_size}; allowed: {IMAGE_SIZES[0]} to {IMAGE_SIZES[1]}")


def is_drawn(settings: Mapping[str, Any]) -> bool:
    """Whether tasks are drawn from a split: a custom scene is its own only task; a world of one task resets to it."""
    return "scene" not in settings and ":" not in settings.get("task", "")


def observations(world: World, image_size: int | None) -> spaces.Box:
    """The space of one world's observations: features, or images of that size."""
    if image_size is not None:
        return spaces.Box(0, 255, (image_size, image_size, 3), np.uint8)
    space = world.data["observation_space"]
    low, high = (np.asarray(space[key], dtype=np.float32) for key in ("low", "high"))
    return spaces.Box(low, high, dtype=np.float32)


def actions(world: World, form: str) -> spaces.Box | spaces.Discrete:
    """The space of one world's actions, `box` or `discrete`."""
    if form == "discrete":
        return spaces.Discrete(world.actions)
    return spaces.Box(0.0, 1.0, (world.dimension,), np.float32)


def picture(world: World, size: int, *, end: bool = False, task: str | None = None) -> NDArray[np.uint8]:
    """(size, size, 3) the scene of the current task or another; or how the last step ended."""
    view = "end" if end else "scene"
    return _square(png.decode(world.render(view=view, width=size, task=task)), size)


def settings_of(task: str | None, world: str | Mapping[str, Any]) -> dict[str, Any]:
    """What `Client.create_world` takes, of the task and world that an environment is made with."""
    if isinstance(world, Mapping):
        known = [name for name in signature(Client.create_world).parameters if name != "self"]
        if unknown := sorted(set(world) - set(known)):
            raise ValueError(f"world has {unknown}; allowed: {', '.join(known)}")
        settings = dict(world)
        if "scene" not in settings and task is not None:
            settings.setdefault("task", task)
        return settings
    _one_of("world", world, ("sim", "real"))
    return {"task": task, "kind": world}


def _plain(info: Mapping[str, Any]) -> dict[str, Any]:
    """What an episode tells, without counts that outlast it: the same episode gives the same info."""
    return {key: value for key, value in info.items() if key != "interactions"}


def _square(picture: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """The picture, cut or filled up with white to (size, size, 3)."""
    if picture.shape == (size, size, 3):
        return picture
    square = np.full((size, size, 3), 255, dtype=np.uint8)
    part = picture[:size, :size]
    square[: part.shape[0], : part.shape[1]] = part
    return square


def _one_of(name: str, value: object, allowed: Sequence[object]) -> None:
    if value not in allowed:
        raise ValueError(f"{name} is {value!r}; allowed: {', '.join(map(repr, allowed))}")
