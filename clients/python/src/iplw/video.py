"""Records films of episodes, like Gymnasium's `RecordVideo`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from . import envs
from .envs import Observation, PlacementEnv
from .film import ffmpeg

#: File formats of films.
FORMATS = ("png", "gif", "webp", "mp4")


def default_format() -> str:
    """`mp4` if ffmpeg is installed; otherwise `gif`, with a warning that says why."""
    try:
        ffmpeg()
    except ValueError as error:
        gymnasium.logger.warn(f"films are written as gif: {error}")
        return "gif"
    return "mp4"


def capped_cubic_schedule(episode: int) -> bool:
    """Gymnasium's default schedule: cubes (0, 1, 8, 27, ...) up to 1000, then every 1000th episode."""
    if episode >= 1000:
        return episode % 1000 == 0
    return bool(round(episode ** (1 / 3)) ** 3 == episode)


class RecordVideo(gymnasium.Wrapper[Observation, Any, Observation, Any], RecordConstructorArgs):
    """Writes a film of the rollout of each episode that `episode_trigger` selects.

        env = iplw.RecordVideo(gymnasium.make("iplw/Bowling-v0"), "films", episode_trigger=lambda episode: True)

    Gymnasium's own takes one frame a step, so it shows the start and the end; this one shows the motion between. It works with
    any `render_mode` and costs no interaction: in a real world the film shows what the step measured.

    `NAME_PREFIX-episode-K.FORMAT` is written before `step` returns, with `-attempt-N` for a second or later valid action of the
    episode; an episode without a valid action has no film, and a warning says so. `films` lists the written files. `format` is
    `mp4` if ffmpeg is installed (`pip install imageio-ffmpeg`) and `gif` otherwise, or `png` (animated) or `webp`.
    """

    def __init__(
        self,
        env: gymnasium.Env[Observation, Any],
        video_folder: str | Path,
        episode_trigger: Callable[[int], bool] = capped_cubic_schedule,
        *,
        name_prefix: str = "rl-video",
        format: str | None = None,
        width: int = envs.RENDER_SIZE,
        fps: int | None = None,
    ) -> None:
        if isinstance(env, gymnasium.vector.VectorEnv):
            raise TypeError("env is a vector environment; allowed: a single one; `envs.film(0).save(path)` writes its first film")
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
            raise TypeError(f"env is {env.unwrapped!r}; allowed: an iplw environment, wrapped or not")
        if format is None:
            format = default_format()
        if format not in FORMATS:
            raise ValueError(f"format is {format!r}; allowed: {', '.join(FORMATS)} (png is animated)")
        if format == "mp4":
            ffmpeg()
        #: Paths of the films written, in order.
        self.films: list[Path] = []
        self._placement = env.unwrapped
        self._folder = Path(video_folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._trigger = episode_trigger
        self._name = name_prefix
        self._format = format
        self._width = width
        self._fps = envs.FPS if fps is None else fps
        self._episode = -1
        #: Actions, and valid ones, in this episode.
        self._steps = self._attempts = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode."""
        self._next_episode()
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """Executes an action and writes the film of the rollout."""
        stepped = super().step(action)
        valid = stepped[-1].get("valid")
        if valid is None:
            # An inner wrapper has started the next episode.
            self._next_episode()
        else:
            self._steps += 1
            self._attempts += valid
        if valid and self._trigger(self._episode):
            attempt = f"-attempt-{self._attempts}" if self._attempts > 1 else ""
            path = self._folder / f"{self._name}-episode-{self._episode}{attempt}.{self._format}"
            self.films.append(self._placement.film(width=self._width, fps=self._fps).save(path))
        return stepped

    def close(self) -> None:
        """Closes the environment."""
        self._next_episode()
        super().close()

    def _next_episode(self) -> None:
        """Counts an episode, and warns if the last one should have had a film."""
        if self._steps and not self._attempts and self._trigger(self._episode):
            gymnasium.logger.warn(f"episode {self._episode} has no film, because none of its actions was valid")
        self._episode += 1
        self._steps = self._attempts = 0
