"""Environments of a control task on the server: reset, step, rollouts, physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray
from typing_extensions import Self

from .. import requests
from .resource import AsyncResource


class AsyncControlWorld(AsyncResource):
    """Environments of one control task; as a context manager it deletes them on exit.

    Arrays have one row per environment. `data["task"]` describes actions, observations, joints and times.
    """

    _get_operation = "get_control_world"
    _closed = False

    @property
    def kind(self) -> str:
        """`sim` or `real`."""
        return str(self.data["kind"])

    @property
    def count(self) -> int:
        """Number of environments."""
        return int(self.data["count"])

    # sync: @property
    async def motion_seconds(self) -> float:
        """Motion of all environments so far, s, from the server."""
        await self.refresh()
        return float(self.data["usage"]["motion_seconds"])

    async def reset(
        self, *, seed: int | None = None, mask: Sequence[bool] | NDArray[Any] | None = None
    ) -> dict[str, NDArray[Any]]:
        """Starts episodes in all environments, or in those that the mask selects: `observation` and measured `position`.

        A seed starts the environments' sequences of episodes anew; without it they continue.
        """
        return await self._connection.do(requests.control("reset_control_world", self.id, self.count, seed=seed, mask=mask))

    async def step(self, actions: Sequence[Sequence[float]] | NDArray[Any], *, autoreset: str = "disabled") -> dict[str, Any]:
        """Steps every environment once: `observation`, `reward`, `terminated`, `truncated`, `success`, `reset`, measured
        `position`, `velocity`, `motion_seconds`.

        actions: (environments, motors), clipped to the motors' ranges. `autoreset`: `disabled`, `next_step` or `same_step`.
        `Problem` (409) before a reset.
        """
        request = requests.control("step_control_world", self.id, self.count, actions=actions, autoreset=autoreset)
        return await self._connection.do(request)

    async def rollout(self, actions: Sequence[Any] | NDArray[Any], *, environment: int = 0) -> dict[str, NDArray[Any]]:
        """Simulates sequences of actions from the state of an environment, which does not change.

        actions: (sequences, steps, motors). Returns `reward` (sequences, steps), 0 after the end of an episode and minus infinity
        where a motion diverges, `steps` until the end, `terminated`, and the last `observation`. `Problem` (409) for a real world.
        """
        request = requests.control(
            "rollout_control_world", self.id, len(actions), actions=actions, environment=environment
        )
        return await self._connection.do(request)

    async def set_physics(
        self, effects: Sequence[Mapping[str, Any]] = (), noise: Mapping[str, float] | None = None
    ) -> Self:
        """Replaces effects in joints, from the next resets on, and the noise of measured positions at once.

        `effects`: `[{"joint": "hinge", "name": "viscous_friction", "parameters": {"b": [0.01, 0.05]}}]`; a range is drawn at
        each reset: domain randomisation. `Problem` (409) for a real world.
        """
        request = requests.post("set_control_physics", {"id": self.id, "effects": list(effects), "noise": dict(noise or {})})
        self.data = await self._connection.do(request)
        return self

    async def render(self, *, environment: int = 0, width: int = 512) -> bytes:
        """Draws the current state of an environment, as PNG."""
        return await self._connection.do(requests.render_control(self.id, environment, width))

    async def close(self) -> None:
        """Deletes the world; idempotent, and ignores a world or server that is already gone."""
        if self._closed:
            return
        self._closed = True
        await self._connection.forget(requests.get("delete_control_world", self.id))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()
