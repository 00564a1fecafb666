"""A world on the server: reset, step, batches of rollouts, rendering."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray
from typing_extensions import Self

from .. import requests
from ..errors import Problem
from ..film import Film
from ..rollout import Action, Rollout, Rollouts, with_context
from ..scene import Scene
from .branch import AsyncBranch
from .resource import AsyncResource
from .job import AsyncJob
from .connection import AsyncConnection


class AsyncWorld(AsyncResource):
    """A world; as a context manager it deletes the world on exit."""

    _get_operation = "get_world"
    _closed = False

    def __init__(self, line: AsyncConnection, data: dict[str, Any], scene: Mapping[str, Any] | None = None) -> None:
        super().__init__(line, data)
        # Scenes by task id: the custom scene, if any, and scenes already requested.
        self._scenes = {str(data["task"]): Scene(scene)} if scene is not None else {}
        self._task: str | None = (data.get("state") or {}).get("task")
        #: Number of the episode that the last reset began; None before one.
        self._episode: int | None = None

    @property
    def kind(self) -> str:
        """`sim` or `real`."""
        return str(self.data["kind"])

    @property
    def latents(self) -> dict[str, float] | None:
        """Density (kg/m^2), friction and restitution, as of the last update; None if the world is sealed."""
        latents: dict[str, float] | None = self.data["latents"]
        return latents

    @property
    def dimension(self) -> int:
        """Number of components of an action vector."""
        return int(self.data["action_space"]["dimension"])

    @property
    def actions(self) -> int:
        """Number of discrete actions."""
        return int(self.data["action_space"]["count"])

    # sync: @property
    async def interactions(self) -> int:
        """Number of valid attempts so far, from the server."""
        await self.refresh()
        return int(self.data["interactions"])

    async def reset(
        self, *, seed: int | None = None, task: str | None = None, split: str | None = None
    ) -> requests.Start:
        """Starts an episode on `task`, or on a task sampled from `split` by `seed`: (observation, info).

        observation: (F,) features of the state, in [0, 1], named in `data["observation_space"]`; info: `task`, `split`, and
        `episode`, its number in the world.
        """
        observation, info = await self._connection.do(requests.reset(self.id, seed, task, split))
        self._task, self._episode = info["task"], info["episode"]
        return observation, info

    async def step(self, action: Action) -> requests.Step:
        """Executes one action: (observation, reward, terminated, truncated, info).

        An invalid action does not end the episode: `info["valid"]` is False and `info["reason"]` gives the reason. The
        observation is (F,), at the end; the reward is 1.0 if the goal was reached, else 0.0. `Problem` before `reset`, after the
        end of an episode and after a reset by another client (409), and if the budget is spent (429).
        """
        return await self._connection.do(requests.step(self.id, action, self._episode))

    async def rollout(
        self,
        actions: Sequence[Action] | NDArray[Any],
        *,
        task: str | None = None,
        trajectories: bool = False,
        stop: bool = True,
        batch: int = 1024,
        interventions: Sequence[Sequence[Mapping[str, Any]]] | None = None,
    ) -> Rollouts:
        """Simulates many actions on one task (default: the episode's), each from the start, as one batch.

        actions: (n, dimension) in [0, 1], (n,) indices, or a list of both. In a real world each valid action is an
        interaction. More than `batch` actions are sent in several requests; if one is rejected, those before it have been
        executed. `stop=False` continues after the goal is reached. `interventions` (simulated worlds): a list for each action,
        or one for all, of dicts such as `{"type": "remove", "at": 1.5, "body": "plank"}` (`docs/reference/formats.md`).
        """
        scene = await self.scene(task) if trajectories else None
        results: list[Rollout] = []
        for request in requests.rollouts(self.id, actions, task, trajectories, stop, batch, interventions):
            part = await self._connection.do(request)
            results.extend(part)
        return Rollouts(with_context(results, actions, scene, stop, interventions) if trajectories else results)

    async def branch(
        self,
        rollout: Rollout | Action | None = None,
        *,
        at: float,
        task: str | None = None,
        stop: bool = True,
    ) -> AsyncBranch:
        """A snapshot of a rollout at time `at` (s since the start; the nearest time step), from which to continue with
        interventions.

        `rollout`: a result of `rollout(..., trajectories=True)` or of a branch, an action, or None for the last step.
        `Problem` in a real or sealed world (403), and beyond the rollout's end (422).
        """
        answer = await self._connection.do(requests.snapshot(self.id, rollout, at, task, stop))
        return AsyncBranch(self._connection, self.id, answer, await self.scene(answer["snapshot"]["task"]))

    async def scene(self, task: str | None = None) -> Scene | None:
        """The scene of a task (default: the episode's) before the action; None if the server does not disclose it.

        It has the family's latents, not those of this world.
        """
        name = task or self._task or str(self.data["task"])
        if name not in self._scenes and ":" in name:
            try:
                self._scenes[name] = Scene((await self._connection.do(requests.task(name)))["scene"])
            except Problem:
                return None
        return self._scenes.get(name)

    async def evaluate(
        self, ranking: Mapping[str, Sequence[Action] | NDArray[Any]], *, attempts: int = 100
    ) -> AsyncJob:
        """Evaluates AUCCESS of an external policy, as a job, from its ranked actions for each task, best first.

        `ranking` maps task ids to (n, dimension) actions; invalid actions do not count. Attempts in a real world are
        interactions.
        """
        answer = await self._connection.do(requests.evaluate_ranking(self.id, ranking, attempts))
        return AsyncJob(self._connection, answer)

    async def set_latents(self, **latents: float) -> Self:
        """Sets density (kg/m^2; or `mass`), friction or restitution. `Problem` (403) in a sealed world."""
        self.data = await self._connection.do(requests.set_latents(self.id, latents))
        return self

    async def render(
        self,
        *,
        format: str | None = None,
        view: str = "scene",
        action: Action | None = None,
        task: str | None = None,
        width: int | None = None,
        fps: int | None = None,
    ) -> bytes:
        """Renders PNG or SVG: the `scene`, or the `end`, a `filmstrip`, an `animation` (SVG) or a `film` (APNG).

        All views except the scene show the last step, as observed, without an interaction. With an `action` they execute it on
        `task`, which is an interaction in a real world.
        """
        return await self._connection.do(requests.render(self.id, format, view, action, task, width, fps))

    async def film(self, *, width: int = 256, fps: int = 30) -> Film:
        """The film of the last step, as observed (with noise), without an interaction.

        `width` in px, 16 to 4096; `fps` in frames per second, 1 to 60. `Problem` (409) if there was no step.
        """
        return await self._connection.do(requests.film(self.id, width, fps))

    async def close(self) -> None:
        """Deletes the world; idempotent, and ignores a world or server that is already gone."""
        if self._closed:
            return
        self._closed = True
        await self._connection.forget(requests.get("delete_world", self.id))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()
