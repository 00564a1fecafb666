"""Action, observation and state on the wire, as subtypes of OpenEnv's."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from openenv.core.env_server.types import Action, Observation, State
from pydantic import Field, ValidationError
from typing_extensions import Self


class IplwAction(Action):
    """One placement."""

    action: int | list[float] = Field(
        description="a vector of numbers from 0 to 1, one for each component of the task's action space (bowling: x, y "
        "and radius of the red ball); or the index of a discrete action",
    )

    @classmethod
    def model_validate(cls, obj: Any, **how: Any) -> Self:
        """Validates an action; `ValueError` with a one-line message if it is invalid.

        OpenEnv's client displays an error's message but not the details where pydantic puts them. A JSON string such as
        `"[0.5, 0.9, 0.3]"` is accepted: OpenEnv's web page and language models send it.
        """
        if isinstance(obj, Mapping) and isinstance(obj.get("action"), str):
            with suppress(ValueError):
                obj = {**obj, "action": json.loads(obj["action"])}
        try:
            action: Self = super().model_validate(obj, **how)
        except ValidationError as error:
            raise ValueError(_error_message(obj, error)) from None
        return action


class IplwObservation(Observation):
    """Observation and result of the action. After `reset`, `valid` is None."""

    features: list[float] = Field(description="(F,) state of the bodies, each in [0, 1]; after a step, at its end")
    task: str = Field(description="id of the task: bowling:017")
    split: str | None = Field(None, description="split of the task: train, validation or test; after reset")
    valid: bool | None = Field(None, description="whether the action could be placed; if not, the episode goes on")
    reason: str | None = Field(None, description="why the action could not be placed")
    solved: bool | None = Field(None, description="whether the goal was reached")
    steps: int | None = Field(None, description="time steps simulated")
    collisions: int | None = Field(None, description="collisions between movable bodies")
    rolling_steps: int | None = Field(None, description="time steps in contact with the floor")
    end: str | None = Field(None, description="how the rollout ended: goal, horizon, ...")
    interactions: int = Field(0, description="valid attempts in this session's world so far")
    remaining: int | None = Field(None, description="real interactions left to all sessions; null without a budget")
    scene: dict[str, Any] | None = Field(None, description="after reset, if shown: the iplw.scene/1 document, SI")
    picture: str | None = Field(
        None, description="if shown: the scene at its start, with what a valid action placed; PNG in base64"
    )


class IplwState(State):
    """State of a session."""

    task: str | None = Field(None, description="id of the episode's task; null before the first reset")
    world: str = Field("sim", description="sim, or real: its latents are hidden and its interactions counted")
    done: bool = Field(False, description="whether the episode has ended")
    interactions: int = Field(0, description="valid attempts in this session's world so far")
    remaining: int | None = Field(None, description="real interactions left to all sessions; null without a budget")
    latents: dict[str, float] | None = Field(
        None, description="density (kg/m^2), friction, restitution; null if hidden"
    )


def _error_message(value: Any, error: ValidationError) -> str:
    """Pydantic's errors as one line."""
    allowed = "allowed: an index, or a list of numbers from 0 to 1, one per component"
    if not isinstance(value, Mapping):
        return f"the action is {value!r}; allowed: an object with the field `action`"
    for issue in error.errors():
        if issue["loc"][0] != "action":
            return f"`{'.'.join(map(str, issue['loc']))}`: {issue['msg']}; allowed: action, metadata"
    return f"`action` is {value['action']!r}; {allowed}" if "action" in value else f"`action` is missing; {allowed}"
