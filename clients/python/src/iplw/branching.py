"""Interventions of a branch in wire format, and the body states of a snapshot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .request import drop_none


@dataclass(frozen=True, eq=False)
class BodyState:
    """State of a body at one time."""

    #: (2,) m
    position: NDArray[np.float64]
    #: rad
    angle: float
    #: (2,) m/s
    velocity: NDArray[np.float64]
    #: rad/s
    angular_velocity: float


def states(answer: Mapping[str, Any]) -> dict[str, BodyState]:
    """The bodies of a snapshot."""
    return {
        name: BodyState(
            np.asarray(state["position"], dtype=np.float64),
            float(state["angle"]),
            np.asarray(state["velocity"], dtype=np.float64),
            float(state["angular_velocity"]),
        )
        for name, state in answer["bodies"].items()
    }


class Changes:
    """Interventions in the middle of a rollout, in the order of the calls.

    Each is applied at `at`, s since the start of the rollout (the nearest time step); default: the time of the branch.
    The observation at that time still shows the state before the intervention.
    """

    def __init__(self) -> None:
        self._changes: list[dict[str, Any]] = []

    @property
    def changes(self) -> list[dict[str, Any]]:
        """The interventions so far; `World.rollout(..., interventions=...)` accepts them if each has an `at`."""
        return [dict(change) for change in self._changes]

    def impulse(
        self, body: str, impulse: ArrayLike, *, point: ArrayLike | None = None, at: float | None = None
    ) -> None:
        """Applies an impulse, (2,) N s: the velocity changes by impulse / mass.

        `point`, (2,) m: the point of application, which also changes the spin; default: the centre of mass.
        """
        self._add("impulse", at, body=body, impulse=pair("impulse", impulse), point=pair("point", point))

    def set(
        self,
        body: str,
        *,
        position: ArrayLike | None = None,
        angle: float | None = None,
        velocity: ArrayLike | None = None,
        angular_velocity: float | None = None,
        at: float | None = None,
    ) -> None:
        """Sets position (2,) m, angle rad, velocity (2,) m/s or angular velocity rad/s of a body; the others stay."""
        numbers = {"angle": finite("angle", angle), "angular_velocity": finite("angular_velocity", angular_velocity)}
        places = {"position": pair("position", position), "velocity": pair("velocity", velocity)}
        self._add("set", at, body=body, **places, **numbers)

    def add(self, body: Mapping[str, Any], *, at: float | None = None) -> None:
        """Adds a body, in the form of a scene's `bodies`: name, shape, position, ..."""
        self._add("add", at, body=dict(body))

    def add_static(self, static: Mapping[str, Any], *, at: float | None = None) -> None:
        """Adds a static object, in the form of a scene's `statics`."""
        self._add("add_static", at, static=dict(static))

    def remove(self, name: str, *, at: float | None = None) -> None:
        """Removes a body or a static object."""
        self._add("remove", at, body=name)

    def set_latents(self, *, at: float | None = None, **latents: float) -> None:
        """Changes density (kg/m^2), friction or restitution."""
        self._add("latents", at, **{name: finite(name, value) for name, value in latents.items()})

    def clear(self) -> None:
        """Discards the interventions so far."""
        self._changes.clear()

    def _add(self, kind: str, at: float | None, **values: Any) -> None:
        self._changes.append({"type": kind, **drop_none(at=finite("at", at), **values)})


def pair(name: str, values: ArrayLike | None) -> list[float] | None:
    """Two finite numbers as a list."""
    if values is None:
        return None
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (2,) or not np.isfinite(array).all():
        raise ValueError(f"{name} is {values!r}; allowed: two finite numbers, x and y")
    return [float(value) for value in array]


def finite(name: str, value: float | None) -> float | None:
    """The value as a float; `ValueError` unless it is finite or None."""
    if value is not None and not np.isfinite(value):
        raise ValueError(f"{name} is {value}; allowed: a finite number")
    return None if value is None else float(value)
