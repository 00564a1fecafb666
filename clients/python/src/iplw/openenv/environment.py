"""`reset`, `step` and `state` of one session, which has its own world."""

from __future__ import annotations

import base64
import secrets
import threading
import uuid
from typing import Any

from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import EnvironmentMetadata

from .. import Client, Problem, World, __version__
from ..envs import draws_tasks, world_settings
from .budget import Budget
from .models import IplwAction, IplwObservation, IplwState
from .settings import Settings

#: Options of `reset`.
RESET_OPTIONS = ("seed", "episode_id", "task", "split", "latents")
#: Width and height of a picture, px.
PICTURE_WIDTH_PX = 256


class IplwEnvironment(Environment[IplwAction, IplwObservation, IplwState]):
    """One session. An episode ends with its first valid action."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, client: Client, settings: Settings, budget: Budget) -> None:
        """`client` and `budget` are shared by all sessions."""
        super().__init__()
        self._client, self._settings, self._budget = client, settings, budget
        self._options = world_settings(settings.task, settings.world)
        self._real = self._options.get("kind", "sim") == "real"
        # Requests of a session are sequential, but the server may close it from another thread.
        self._lock = threading.Lock()
        self._world: World | None = None
        self._closed = False
        self._state = IplwState(world="real" if self._real else "sim", remaining=self._remaining())

    def reset(self, seed: int | None = None, episode_id: str | None = None, **options: Any) -> IplwObservation:
        """Starts an episode on a task sampled from a split by `seed`.

        `task`: id of a task instead (`bowling:017`); `split`: `train`, `validation` or `test`; `latents`: density (kg/m^2),
        friction or restitution of a simulated world. Other options raise `ValueError`.
        """
        if unknown := sorted(set(options) - set(RESET_OPTIONS)):
            raise ValueError(f"reset does not accept {unknown}; allowed: {', '.join(RESET_OPTIONS)}")
        with self._lock:
            first, world = self._world is None, self._open_world()
            if latents := options.get("latents"):
                world.set_latents(**latents)
            task, split = options.get("task"), options.get("split")
            if split is None and task is None and draws_tasks(self._options):
                split = self._settings.split
            if seed is None and first:
                # Every world's scene sequence of tasks is the same; sessions that do not care get different ones.
                seed = secrets.randbits(32)
            features, info = world.reset(seed=seed, task=task, split=split)
            self._state = IplwState(
                episode_id=episode_id or str(uuid.uuid4()),
                task=str(info["task"]),
                world=self._state.world,
                interactions=self._state.interactions,
                remaining=self._remaining(),
                latents=world.latents,
            )
            return IplwObservation(
                features=features.tolist(),
                task=str(info["task"]),
                split=info.get("split"),
                interactions=self._state.interactions,
                remaining=self._remaining(),
                scene=self._scene(str(info["task"])),
                picture=self._picture(),
            )

    def step(self, action: IplwAction, timeout_s: float | None = None, **_: Any) -> IplwObservation:
        """Executes an action. `RuntimeError` before `reset`; `PermissionError` if the budget is spent.

        `timeout_s` is ignored: the limits of the iplw server apply.
        """
        with self._lock:
            if self._world is None:
                raise RuntimeError("no episode has started; call reset first (use /ws: HTTP requests do not share a session)")
            if not self._real:
                return self._act(self._world, action)
            with self._budget.attempt() as attempt:
                try:
                    observation = self._act(self._world, action)
                    attempt.counts = bool(observation.valid)
                except (Problem, ValueError) as error:
                    # A rejected action was not executed; after a server error or a timeout it may have been.
                    attempt.counts = isinstance(error, Problem) and (error.status >= 500 or error.status == 408)
                    raise
            observation.remaining = self._state.remaining = self._remaining()
            return observation

    @property
    def state(self) -> IplwState:
        """State of the session; sends no request."""
        return self._state

    def get_metadata(self) -> EnvironmentMetadata:
        """Description of the worlds."""
        what = self._settings.task or "a custom scene"
        kind = "the real world: latents hidden, interactions counted" if self._real else "a simulated world"
        return EnvironmentMetadata(
            name="iplw",
            description=f"2D physics, {what}, {kind}. Place a body; the world rolls out; the goal is reached or not.",
            version=__version__,
            author="iplw",
        )

    def close(self) -> None:
        """Deletes the world; the session cannot be used afterwards. Idempotent."""
        with self._lock:
            self._closed = True
            world, self._world = self._world, None
            if world is not None:
                world.close()

    def _open_world(self) -> World:
        """The session's world, created when it is first needed; reading the state needs none."""
        if self._closed:
            raise RuntimeError("the world of this session was deleted because the session was idle; connect again")
        if self._world is None:
            self._world = self._client.create_world(**self._options)
        return self._world

    def _act(self, world: World, action: IplwAction) -> IplwObservation:
        features, reward, terminated, _, info = world.step(action.action)
        self._state.step_count += 1
        self._state.done = terminated
        self._state.interactions = int(info["interactions"])
        return IplwObservation(
            done=terminated,
            reward=reward,
            features=features.tolist(),
            task=str(info["task"]),
            valid=bool(info["valid"]),
            reason=info.get("reason"),
            solved=info.get("solved"),
            steps=info.get("steps"),
            collisions=info.get("collisions"),
            rolling_steps=info.get("rolling_steps"),
            end=info.get("end"),
            interactions=self._state.interactions,
            remaining=self._remaining(),
            picture=self._picture(action.action if info["valid"] else None),
        )

    def _remaining(self) -> int | None:
        return self._budget.remaining if self._real else None

    def _scene(self, task: str) -> dict[str, Any] | None:
        if "scene" not in self._settings.show:
            return None
        scene = self._options.get("scene")
        return dict(scene) if scene is not None else dict(self._client.task(task)["scene"])

    def _picture(self, action: int | list[float] | None = None) -> str | None:
        if "picture" not in self._settings.show or self._world is None:
            return None
        return base64.b64encode(self._world.render(width=PICTURE_WIDTH_PX, action=action)).decode("ascii")
