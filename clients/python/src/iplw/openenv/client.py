"""Typed OpenEnv client."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from openenv.core.client_types import StepResult
from openenv.core.env_client import EnvClient

from .models import IplwAction, IplwObservation, IplwState


class IplwEnv(EnvClient[IplwAction, IplwObservation, IplwState]):
    """A session in a world: `await env.reset(seed=1)`, `await env.step(IplwAction(action=[...]))`, `await env.state()`.

    `IplwEnv(base_url=...).sync()` is the same without `await`. `openenv.core.GenericEnvClient` works with plain
    dictionaries: `env.step({"action": [0.5, 0.9, 0.3]})`. An error of the server raises `RuntimeError` with its message.
    """

    def _step_payload(self, action: IplwAction) -> dict[str, Any]:
        return dict(action.model_dump(exclude_defaults=True))

    def _parse_result(self, payload: Mapping[str, Any]) -> StepResult[IplwObservation]:
        outcome = {"reward": payload.get("reward"), "done": bool(payload.get("done"))}
        observation = IplwObservation.model_validate({**payload["observation"], **outcome})
        return StepResult(observation=observation, **outcome)

    def _parse_state(self, payload: Mapping[str, Any]) -> IplwState:
        state: IplwState = IplwState.model_validate(payload)
        return state
