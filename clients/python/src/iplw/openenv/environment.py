"""`reset`, `step` and `state` of one session: one world of its own, which goes with the session."""

from __future__ import annotations

import base64
import secrets
import threading
import uuid
from typing import Any

from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import EnvironmentMetadata

from .. import Client, Problem, World, __version__
from ..envs import is_drawn, settings_of
from .budget import Budget
from .models import IplwAction, IplwObservation, IplwState
from .settings import Settings

#: What `reset` takes.
TAKES = ("seed", "episode_id", "task", "split", "latents")
#: Pixels on a side of a picture.
PICTURE = 256


class IplwEnvironment(Environment[IplwAction, IplwObservation, IplwState]):
    """One session. An episode is one attempt: a valid action ends it, one that cannot be placed leaves it open."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, client: Client, settings: Settings, budget: Budget) -> None:
        """`client`: the connection, shared by all sessions; `budget`: real interactions, theirs, too."""
        super().__init__()
        self._client, self._settings, self._budget = client, settings, budget
        self._options = settings_of(settings.task, settings.world)
        self._real = self._options.get("kind", "sim") == "real"
        # A session's requests come one by one, but the server may let go of it from another thread.
        self._lock = threading.Lock()
        self._world: World | None = None
        self._closed = False
        self._state = IplwState(world="real" if self._real else "sim", remaining=self._left())

    def reset(self, seed: int | None = None, episode_id: str | None = None, **given: Any) -> IplwObservation:
        """Begins an episode, on a task drawn from a split by `seed`.

        `task`: id of the task instead (`bowling:017`); `split`: `train`, `validation` or `test`; `latents`: some of
        density (kg/m^2), friction and restitution, in a simulated world. Anything else is a `ValueError`.
        """
        if unknown := sorted(set(given) - set(TAKES)):
            raise ValueError(f"reset has {unknown}; allowed: {', '.join(TAKES)}")
        with self._lock:
            first, world = self._world is None, self._opened()
            if latents := given.get("latents"):
                world.set_latents(**latents)
            task, split = given.get("task"), given.get("split")
            if split is None and task is None and is_drawn(self._options):
                split = self._settings.split
            if seed is None and first:
                # Every world's own sequence of tasks is the same; sessions that do not care get different ones.
                seed = secrets.randbits(32)
            features, info = world.reset(seed=seed, task=task, split=split)
            self._state = IplwState(
                episode_id=episode_id or str(uuid.uuid4()),
                task=str(info["task"]),
                world=self._state.world,
                interactions=self._state.interactions,
                remaining=self._left(),
                latents=world.latents,
            )
            return IplwObservation(
                features=features.tolist(),
                task=str(info["task"]),
                split=info.get("split"),
                interactions=self._state.interactions,
                remaining=self._left(),
                scene=self._scene(str(info["task"])),
                picture=self._picture(),
            )

    def step(self, action: IplwAction, timeout_s: float | None = None, **_: Any) -> IplwObservation:
        """Carries an action out. `RuntimeError` before `reset`; `PermissionError` once the budget is spent.

        `timeout_s` is for environments that can stop in the middle; here the iplw server's own limits hold.
        """
        with self._lock:
            if self._world is None:
                raise RuntimeError("no episode has begun; reset first (over /ws: each request over HTTP is on its own)")
            if not self._real:
                return self._act(self._world, action)
            with self._budget.attempt() as attempt:
                try:
                    seen = self._act(self._world, action)
                    attempt.counts = bool(seen.valid)
                except (Problem, ValueError) as error:
                    # Refused, so nothing of it was done; what broke off or took too long may have been.
                    attempt.counts = isinstance(error, Problem) and (error.status >= 500 or error.status == 408)
                    raise
            seen.remaining = self._state.remaining = self._left()
            return seen

    @property
    def state(self) -> IplwState:
        """Where the session stands; asks nobody."""
        return self._state

    def get_metadata(self) -> EnvironmentMetadata:
        """What the worlds are, in words."""
        what = self._settings.task or "a scene of its own"
        kind = "the real world: latents hidden, interactions counted" if self._real else "a simulated world"
        return EnvironmentMetadata(
            name="iplw",
            description=f"2D physics, {what}, {kind}. Place a body; the world rolls out; the goal is reached or not.",
            version=__version__,
            author="iplw",
        )

    def close(self) -> None:
        """Deletes the world; a second call does nothing. After it the session is of no use."""
        with self._lock:
            self._closed = True
            world, self._world = self._world, None
            if world is not None:
                world.close()

    def _opened(self) -> World:
        """The session's world, made when it is first needed: what only asks for the state makes none."""
        if self._closed:
            raise RuntimeError("this session was idle for too long and its world is gone; connect anew")
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
            remaining=self._left(),
            picture=self._picture(action.action if info["valid"] else None),
        )

    def _left(self) -> int | None:
        return self._budget.remaining if self._real else None

    def _scene(self, task: str) -> dict[str, Any] | None:
        if "scene" not in self._settings.show:
            return None
        own = self._options.get("scene")
        return dict(own) if own is not None else dict(self._client.task(task)["scene"])

    def _picture(self, action: int | list[float] | None = None) -> str | None:
        if "picture" not in self._settings.show or self._world is None:
            return None
        return base64.b64encode(self._world.render(width=PICTURE, action=action)).decode("ascii")
