"""Films of episodes in a folder, in the manner of Gymnasium's `RecordVideo`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from . import envs
from .envs import Observation, PlacementEnv

#: Files a film can be written as.
FORMATS = ("png", "gif", "webp", "mp4")


def ever_fewer(episode: int) -> bool:
    """Gymnasium's usual choice: cubes (0, 1, 8, 27, ...) up to 1000, then every thousandth."""
    if episode >= 1000:
        return episode % 1000 == 0
    return bool(round(episode ** (1 / 3)) ** 3 == episode)


class RecordVideo(gymnasium.Wrapper[Observation, Any, Observation, Any], RecordConstructorArgs):
    """Writes a film of every episode that `episode_trigger` chooses: all of its rollout, and not one frame a step.

        env = iplw.RecordVideo(gymnasium.make("iplw/Bowling-v0"), "films", episode_trigger=lambda episode: True)

    The environment's `render_mode` does not matter, and nothing is measured for it: in a real world a film shows what the
    episode's step measured. `NAME_PREFIX-episode-K.FORMAT` is written before `step` returns; an episode without a valid
    action has none. The files written are in `films`.
    """

    def __init__(
        self,
        env: gymnasium.Env[Observation, Any],
        video_folder: str | Path,
        episode_trigger: Callable[[int], bool] = ever_fewer,
        *,
        name_prefix: str = "rl-video",
        format: str = "png",
        width: int = envs.RENDER_SIZE,
        fps: int | None = None,
    ) -> None:
        RecordConstructorArgs.__init__(
            self,
            video_folder=str(video_folder),
            episode_trigger=episode_trigger,
            name_prefix=name_prefix,
            format=format,
            width=width,
            fps=fps,
        )
        gymnasium.Wrapper.__init__(self, env)
        if not isinstance(env.unwrapped, PlacementEnv):
            raise TypeError(f"env is {env.unwrapped!r}; allowed: an environment of iplw, wrapped or not")
        if format not in FORMATS:
            raise ValueError(f"format is {format!r}; allowed: {', '.join(FORMATS)} (an animated PNG)")
        #: Paths of the films written, in order.
        self.films: list[Path] = []
        self._placement = env.unwrapped
        self._folder = Path(video_folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._trigger = episode_trigger
        self._name = name_prefix
        self._format = format
        self._width = width
        self._fps = int(self.metadata["render_fps"]) if fps is None else fps
        self._episode = -1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode."""
        self._episode += 1
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """Acts, and writes the film of what it brought."""
        stepped = super().step(action)
        valid = stepped[-1].get("valid")
        if valid is None:
            # A wrapper within has begun the next episode instead.
            self._episode += 1
        if valid and self._trigger(self._episode):
            path = self._folder / f"{self._name}-episode-{self._episode}.{self._format}"
            self.films.append(self._placement.film(width=self._width, fps=self._fps).save(path))
        return stepped
