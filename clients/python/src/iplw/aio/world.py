"""A world on the server: reset, step, roll out batches, look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray
from typing_extensions import Self

from .. import calls
from ..errors import Problem
from ..film import Film
from ..rollout import Action, Rollout, Rollouts, told
from ..scene import Scene
from .branch import AsyncBranch
from .handle import AsyncHandle
from .job import AsyncJob
from .line import AsyncLine


class AsyncWorld(AsyncHandle):
    """A handle on one world; also a context manager that deletes it."""

    _look = "get_world"
    _closed = False

    def __init__(self, line: AsyncLine, data: dict[str, Any], scene: Mapping[str, Any] | None = None) -> None:
        super().__init__(line, data)
        # Of its own, where it was made of one; and of tasks that were looked at.
        self._scenes = {str(data["task"]): Scene(scene)} if scene is not None else {}
        self._task: str | None = (data.get("state") or {}).get("task")

    @property
    def kind(self) -> str:
        """`sim` or `real`."""
        return str(self.data["kind"])

    @property
    def latents(self) -> dict[str, float] | None:
        """Density (kg/m^2), friction and restitution, as of the last look; None if the world is sealed."""
        latents: dict[str, float] | None = self.data["latents"]
        return latents

    @property
    def dimension(self) -> int:
        """Numbers in an action vector."""
        return int(self.data["action_space"]["dimension"])

    @property
    def actions(self) -> int:
        """How many discrete actions there are."""
        return int(self.data["action_space"]["count"])

    # sync: @property
    async def interactions(self) -> int:
        """Valid attempts on this world so far; asks the server."""
        await self.refresh()
        return int(self.data["interactions"])

    async def reset(
        self, *, seed: int | None = None, task: str | None = None, split: str | None = None
    ) -> calls.Start:
        """Starts an episode on `task`, or on one drawn from `split` by `seed`: (observation, info).

        observation: (F,) state of the bodies, in [0, 1], named in `data["observation_space"]`; info: `task`, `split`.
        """
        observation, info = await self._line.do(calls.reset(self.id, seed, task, split))
        self._task = info["task"]
        return observation, info

    async def step(self, action: Action) -> calls.Step:
        """Acts once: (observation, reward, terminated, truncated, info).

        An action that cannot be placed leaves the episode open: `info["valid"]` is False and
        `info["reason"]` says why. The observation is (F,), at the end; the reward 1.0 if the goal was reached, else 0.0.
        `Problem` before `reset` and after the end of an episode (409), and once a budget is spent (429).
        """
        return await self._line.do(calls.step(self.id, action))

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
        """Rolls out many actions on one task (default: the episode's), each from the start, as one batch.

        actions: (n, dimension) in [0, 1], (n,) indices, or a list of both. On a real world each valid one is an interaction.
        More than `batch` actions go out in several requests; if one is refused, those before it have
        happened. `stop=False` goes on after the goal is reached. `interventions` are done in the middle of rollouts of a
        simulated world: a list for each action, or one for all, of dicts such as `{"type": "remove", "at": 1.5, "body":
        "plank"}` (`docs/formats.md`).
        """
        scene = await self.scene(task) if trajectories else None
        results: list[Rollout] = []
        for call in calls.rollouts(self.id, actions, task, trajectories, stop, batch, interventions):
            part = await self._line.do(call)
            results.extend(part)
        return Rollouts(told(results, actions, scene, stop, interventions) if trajectories else results)

    async def branch(
        self,
        rollout: Rollout | Action | None = None,
        *,
        at: float,
        task: str | None = None,
        stop: bool = True,
    ) -> AsyncBranch:
        """A moment `at` (s since the start; the nearest time step) in a rollout, from which to go on with something else done.

        `rollout` is one that `rollout(..., trajectories=True)` or a branch gave, an action, or None for the step that was
        made last. `Problem` on a real or sealed world (403), and beyond the rollout's end (422).
        """
        answer = await self._line.do(calls.snapshot(self.id, rollout, at, task, stop))
        return AsyncBranch(self._line, self.id, answer, await self.scene(answer["snapshot"]["task"]))

    async def scene(self, task: str | None = None) -> Scene | None:
        """The scene of a task (default: the episode's) before anything is placed; None where the server does not tell.

        Latents in it are the family's own, not those that this world was given.
        """
        name = task or self._task or str(self.data["task"])
        if name not in self._scenes and ":" in name:
            try:
                self._scenes[name] = Scene((await self._line.do(calls.task(name)))["scene"])
            except Problem:
                return None
        return self._scenes.get(name)

    async def evaluate(
        self, ranking: Mapping[str, Sequence[Action] | NDArray[Any]], *, attempts: int = 100
    ) -> AsyncJob:
        """AUCCESS of a policy of your own, as a job: its actions for each task, best first, are tried here.

        `ranking` maps task ids to (n, dimension) actions; those that cannot be placed do not count. Attempts on a
        real world are interactions.
        """
        answer = await self._line.do(calls.evaluate_ranking(self.id, ranking, attempts))
        return AsyncJob(self._line, answer)

    async def set_latents(self, **latents: float) -> Self:
        """Sets some of density (kg/m^2; or `mass`), friction, restitution. A sealed world refuses with a `Problem` (403)."""
        self.data = await self._line.do(calls.set_latents(self.id, latents))
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
        """A picture as PNG or SVG: the `scene`, or the `end`, a `filmstrip`, an `animation` (SVG) or a `film` (APNG).

        All but the scene show the step that was made last, as it was observed and at no interaction. With an `action`
        they attempt it, on `task`, which in a real world is an interaction.
        """
        return await self._line.do(calls.render(self.id, format, view, action, task, width, fps))

    async def film(self, *, width: int = 256, fps: int = 30) -> Film:
        """The step that was made last, frame by frame, as it was observed: noise and all, at no interaction.

        `width` in pixels, 16 to 4096; `fps` frames a second, 1 to 60. Where no step was made, a `Problem` (409).
        """
        return await self._line.do(calls.film(self.id, width, fps))

    async def close(self) -> None:
        """Deletes the world; a second call does nothing, nor does a world or server that is already gone."""
        if self._closed:
            return
        self._closed = True
        await self._line.forget(calls.get("delete_world", self.id))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()
