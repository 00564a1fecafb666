"""What a branch is made of: changes as the wire has them, and the states that a snapshot shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .call import given


@dataclass(frozen=True, eq=False)
class BodyState:
    """How a body is at a moment."""

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
    """What is done in the middle of a rollout, in the order in which it is asked for.

    Each change happens at `at`, s since the start of the rollout (the nearest time step), or at the branch's own moment.
    The observation of that moment still shows the state before.
    """

    def __init__(self) -> None:
        self._changes: list[dict[str, Any]] = []

    @property
    def changes(self) -> list[dict[str, Any]]:
        """The changes so far, as `World.rollout(..., interventions=...)` takes them where each has its `at`."""
        return [dict(change) for change in self._changes]

    def impulse(
        self, body: str, impulse: ArrayLike, *, point: ArrayLike | None = None, at: float | None = None
    ) -> None:
        """A blow of (2,) N s: the velocity changes by impulse / mass at once.

        `point`, (2,) m, is where it acts, which also turns the body; the centre of mass if absent.
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
        """Puts a body at (2,) m, turned to `angle` rad, or gives it (2,) m/s and rad/s; what is absent stays."""
        numbers = {"angle": finite("angle", angle), "angular_velocity": finite("angular_velocity", angular_velocity)}
        places = {"position": pair("position", position), "velocity": pair("velocity", velocity)}
        self._add("set", at, body=body, **places, **numbers)

    def add(self, body: Mapping[str, Any], *, at: float | None = None) -> None:
        """Lets a body in, as `bodies` of a scene has them: name, shape, position, ..."""
        self._add("add", at, body=dict(body))

    def add_static(self, static: Mapping[str, Any], *, at: float | None = None) -> None:
        """Lets something in that never moves, as `statics` of a scene has them."""
        self._add("add_static", at, static=dict(static))

    def remove(self, name: str, *, at: float | None = None) -> None:
        """Takes a body or a static away."""
        self._add("remove", at, body=name)

    def set_latents(self, *, at: float | None = None, **latents: float) -> None:
        """Makes some of density (kg/m^2), friction and restitution others."""
        self._add("latents", at, **{name: finite(name, value) for name, value in latents.items()})

    def clear(self) -> None:
        """Forgets the changes so far."""
        self._changes.clear()

    def _add(self, kind: str, at: float | None, **values: Any) -> None:
        self._changes.append({"type": kind, **given(at=finite("at", at), **values)})


def pair(name: str, values: ArrayLike | None) -> list[float] | None:
    """Two finite numbers as the wire has them."""
    if values is None:
        return None
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (2,) or not np.isfinite(array).all():
        raise ValueError(f"{name} is {values!r}; allowed: two finite numbers, x and y")
    return [float(value) for value in array]


def finite(name: str, value: float | None) -> float | None:
    """A finite number, or None."""
    if value is not None and not np.isfinite(value):
        raise ValueError(f"{name} is {value}; allowed: a finite number")
    return None if value is None else float(value)
