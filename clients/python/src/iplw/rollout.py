"""Rollouts as NumPy arrays, and actions in wire format."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .scene import Scene
from .display.drawing import drawing
from .display.page import card, paragraph, side_by_side, table

if TYPE_CHECKING:
    import pandas

#: An action: a vector with components in [0, 1], or the index of a discrete action.
Action: TypeAlias = "int | Sequence[float] | NDArray[Any] | np.integer[Any]"


#: Trajectories drawn in addition to the first.
MAX_DRAWN = 23


@dataclass(frozen=True, eq=False)
class Rollout:
    """The result of one action."""

    #: Whether the action could be placed; if not, `reason` is given and nothing was simulated.
    valid: bool
    #: Why the action could not be placed.
    reason: str | None
    #: Whether the goal was reached; None if there is no goal or the action is invalid.
    solved: bool | None
    #: Time steps simulated.
    steps: int
    #: Collisions between movable bodies.
    collisions: int
    #: Time steps in contact with the floor.
    rolling_steps: int
    #: (n,) observation times, s; None unless trajectories were requested.
    t: NDArray[np.float64] | None = None
    #: name -> (n, 3) x and y of the centre, m, and angle, rad; empty unless trajectories were requested.
    bodies: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    #: The action: an index, or a vector.
    action: Any = field(default=None, repr=False)
    #: The scene before the action is placed; None if unknown.
    scene: Scene | None = field(default=None, repr=False)
    #: name -> (n, 3) velocity in x and y, m/s, and angular velocity, rad/s; only for a branch.
    velocities: dict[str, NDArray[np.float64]] = field(default_factory=dict, repr=False)
    #: Id of the task; None if unknown.
    task: str | None = field(default=None, repr=False)
    #: Whether the rollout stops when the goal is reached.
    stop: bool = field(default=True, repr=False)
    #: Interventions, in the format of `World.rollout`.
    interventions: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    @property
    def placed(self) -> Scene | None:
        """The scene after placing the action; for a discrete action, the scene before."""
        vector = isinstance(self.action, (list, np.ndarray))
        return self.scene.placed(self.action) if self.scene is not None and vector else self.scene

    def frame(self) -> pandas.DataFrame:
        """The trajectory as a pandas data frame: `t,body,x,y,angle`, one row for each observation and body."""
        import pandas as pd

        if self.t is None:
            raise ValueError(
                "this rollout has no trajectory; create it with rollout(..., trajectories=True)"
            )
        parts = [
            pd.DataFrame(
                {"t": self.t, "body": name, "x": track[:, 0], "y": track[:, 1], "angle": track[:, 2]}
            )
            for name, track in self.bodies.items()
        ]
        return pd.concat(parts, ignore_index=True)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(f"<iplw.Rollout valid={self.valid} solved={self.solved} steps={self.steps}>")

    def _repr_html_(self) -> str:
        facts = [
            ("solved", "–" if self.solved is None else self.solved),
            ("steps", self.steps),
            ("collisions between bodies", self.collisions),
            ("steps on the floor", self.rolling_steps),
        ]
        if not self.valid:
            return card("rollout", paragraph(f"could not be placed: {self.reason}"))
        if self.t is None:
            return card("rollout", table(["", ""], facts), note="without trajectory: rollout(..., trajectories=True)")
        seconds = f"{self.t[-1] - self.t[0]:.4g} s" if len(self.t) else ""
        return card("rollout", side_by_side(drawing(self.placed, [self.bodies]), table(["", ""], facts)), note=seconds)


class Rollouts(Sequence[Rollout]):
    """The results of a batch of actions, in their order; also as arrays."""

    def __init__(self, items: Iterable[Rollout]) -> None:
        self._items = list(items)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n,) whether per_action action could be placed."""
        return np.array([r.valid for r in self._items], dtype=np.bool_)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """(n,) whether per_action action reached the goal; False for one that could not be placed."""
        return np.array([bool(r.solved) for r in self._items], dtype=np.bool_)

    @property
    def steps(self) -> NDArray[np.int64]:
        """(n,) time steps simulated."""
        return np.array([r.steps for r in self._items], dtype=np.int64)

    @overload
    def __getitem__(self, index: int) -> Rollout: ...
    @overload
    def __getitem__(self, index: slice) -> Rollouts: ...
    def __getitem__(self, index: int | slice) -> Rollout | Rollouts:
        if isinstance(index, slice):
            return Rollouts(self._items[index])
        return self._items[index]

    def __len__(self) -> int:
        return len(self._items)

    def frame(self) -> pandas.DataFrame:
        """All trajectories as one pandas data frame: `trial,t,body,x,y,angle`.

        `trial` is the index of the action in the batch; invalid actions have no rows. Columns and order (by trial and time)
        are those of a trials file, which `Client.diagnose` reads.
        """
        import pandas as pd

        parts = [r.frame().sort_values("t", kind="stable").assign(trial=i) for i, r in enumerate(self._items) if r.valid]
        columns = ["trial", "t", "body", "x", "y", "angle"]
        return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)

    def outcomes(self) -> pandas.DataFrame:
        """The result of each action as a pandas data frame, one row for each action: `valid,solved,steps,collisions,...`."""
        import pandas as pd

        names = ["valid", "solved", "steps", "collisions", "rolling_steps", "reason"]
        return pd.DataFrame([[getattr(r, name) for name in names] for r in self._items], columns=names)

    def _repr_html_(self) -> str:
        valid, solved = int(self.valid.sum()), int(self.solved.sum())
        with_trajectory = [r for r in self._items if r.t is not None and r.valid]
        reasons = sorted({str(r.reason) for r in self._items if not r.valid})
        parts = [paragraph(f"not placed: {'; '.join(reasons[:4])}")] if reasons else []
        # Draw the trajectories only: initial states may differ between actions.
        if with_trajectory:
            first = next((r for r in with_trajectory if r.solved), with_trajectory[0])
            others = [r.bodies for r in with_trajectory if r is not first][:MAX_DRAWN]
            parts.insert(0, drawing(first.placed, [first.bodies, *others]))
        return card("rollouts", *parts, note=f"{len(self)} actions: {valid} valid, {solved} solved")

    def __repr__(self) -> str:
        return f"<iplw.Rollouts {len(self)}: {self.valid.sum()} valid, {self.solved.sum()} solved>"


def encode(action: Action | ArrayLike, name: str = "action") -> int | list[float]:
    """An action in wire format: an index, or a list of finite numbers."""
    # Fast path for common types: NumPy checks would take longer than the simulation.
    numbers: Any = None
    if type(action) is np.ndarray and action.ndim == 1 and action.dtype.char in "efd":
        numbers = action.tolist()
    elif isinstance(action, list) and all([type(number) is float for number in action]):
        numbers = action
    if numbers is not None and all(map(math.isfinite, numbers)):
        return list(numbers)
    array = np.asarray(action)  # A pandas Series, too.
    if array.ndim == 0 and np.issubdtype(array.dtype, np.integer):
        return int(array)
    if array.ndim != 1 or not (
        np.issubdtype(array.dtype, np.floating) or np.issubdtype(array.dtype, np.integer)
    ):
        raise ValueError(
            f"{name} is {action!r}; allowed: an index, or a vector of numbers from 0 to 1, one for each component"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is {action!r}; allowed: finite numbers from 0 to 1")
    values: list[float] = array.astype(np.float64).tolist()
    return values


def encode_all(actions: Sequence[Action] | NDArray[Any]) -> NDArray[Any] | list[int | list[float]]:
    """Many actions in wire format: an array if all are indices or all are vectors, else a list."""
    # Iterating a pandas frame would yield its columns instead of its rows.
    actions = actions.to_numpy() if hasattr(actions, "to_numpy") else actions
    if isinstance(actions, np.ndarray) and (
        (actions.ndim == 1 and np.issubdtype(actions.dtype, np.integer))
        or (actions.ndim == 2 and np.issubdtype(actions.dtype, np.floating))
    ):
        finite = np.isfinite(actions).all(axis=-1) if actions.ndim == 2 else np.True_
        if not np.all(finite):
            encode(actions[int(np.argmin(finite))], f"actions[{int(np.argmin(finite))}]")
        return actions
    return [encode(action, f"actions[{i}]") for i, action in enumerate(actions)]


def read_rollouts(answer: Mapping[str, Any]) -> list[Rollout]:
    """Parses the results of a batch, as arrays or as lists."""
    results, task = answer["results"], answer.get("task")
    if "states" in answer:
        return [_rollout(result, *_from_arrays(answer, i), task) for i, result in enumerate(results)]
    return [_rollout(result, *_from_lists(result), task) for result in results]


def read_branch(answer: Mapping[str, Any]) -> Rollout:
    """Parses the rollout of a branch."""
    velocities = {
        name: np.column_stack([np.asarray(track[key], dtype=np.float64) for key in ("vx", "vy", "omega")])
        for name, track in answer["bodies"].items()
    }
    return replace(_rollout({"valid": True, **answer}, *_from_lists(answer)), velocities=velocities)


def with_context(
    results: Sequence[Rollout],
    actions: Sequence[Action] | NDArray[Any],
    scene: Scene | None,
    stop: bool = True,
    interventions: Sequence[Sequence[Mapping[str, Any]]] | None = None,
) -> list[Rollout]:
    """Adds to each rollout its action, scene and interventions."""
    lists = [()] if interventions is None else [tuple(changes) for changes in interventions]
    per_action = lists * len(results) if len(lists) == 1 else lists
    return [
        replace(result, action=action, scene=scene, stop=stop, interventions=changes)
        for result, action, changes in zip(results, encode_all(actions), per_action)
    ]


_Track: TypeAlias = "tuple[NDArray[np.float64] | None, dict[str, NDArray[np.float64]]]"


def _from_arrays(answer: Mapping[str, Any], i: int) -> _Track:
    """One trajectory from batch arrays: times (N, T), states (N, bodies, T, 3), lengths (N,)."""
    length = int(answer["length"][i])
    if not answer["results"][i]["valid"]:
        return None, {}
    states = answer["states"][i, :, :length]
    return answer["t"][i, :length], dict(zip(answer["bodies"], states))


def _from_lists(result: Mapping[str, Any]) -> _Track:
    """One trajectory from lists."""
    t = result.get("t")
    return None if t is None else np.asarray(t, dtype=np.float64), {
        name: np.column_stack([np.asarray(track[key], dtype=np.float64) for key in ("x", "y", "angle")])
        for name, track in (result.get("bodies") or {}).items()
    }


def _rollout(
    result: Mapping[str, Any],
    t: NDArray[np.float64] | None,
    bodies: dict[str, NDArray[np.float64]],
    task: str | None = None,
) -> Rollout:
    contacts = result.get("contacts") or {}
    return Rollout(
        valid=bool(result["valid"]),
        reason=result.get("reason"),
        solved=result.get("solved"),
        steps=int(result.get("steps") or 0),
        collisions=int(contacts.get("collisions") or 0),
        rolling_steps=int(contacts.get("rolling_steps") or 0),
        t=t,
        bodies=bodies,
        task=task,
    )
