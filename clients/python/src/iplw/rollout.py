"""What became of actions, as NumPy arrays; and actions as the wire has them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import pandas

#: One action: a vector in [0, 1], one number a component; or the index of a discrete action.
Action: TypeAlias = "int | Sequence[float] | NDArray[Any] | np.integer[Any]"


@dataclass(frozen=True, eq=False)
class Rollout:
    """What became of one action."""

    #: Whether it could be placed; if not, `reason` says why and nothing moved.
    valid: bool
    #: Why the action could not be placed.
    reason: str | None
    #: Whether the goal was reached; None without a goal or a rollout.
    solved: bool | None
    #: Time steps simulated.
    steps: int
    #: Collisions between movable bodies.
    collisions: int
    #: Time steps in contact with the floor.
    rolling_steps: int
    #: (n,) times of observation, s; None unless trajectories were asked for.
    t: NDArray[np.float64] | None = None
    #: name -> (n, 3) x and y of the centre, m, and angle, rad; empty unless trajectories were asked for.
    bodies: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def frame(self) -> pandas.DataFrame:
        """The trajectory as a pandas data frame: `t,body,x,y,angle`, a row per observation and body."""
        import pandas as pd

        if self.t is None:
            raise ValueError(
                "this rollout has no trajectory; ask for it with rollout(..., trajectories=True)"
            )
        parts = [
            pd.DataFrame(
                {"t": self.t, "body": name, "x": track[:, 0], "y": track[:, 1], "angle": track[:, 2]}
            )
            for name, track in self.bodies.items()
        ]
        return pd.concat(parts, ignore_index=True)


class Rollouts(Sequence[Rollout]):
    """What became of a batch of actions, in their order; also as arrays."""

    def __init__(self, items: Iterable[Rollout]) -> None:
        self._items = list(items)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n,) whether each action could be placed."""
        return np.array([r.valid for r in self._items], dtype=np.bool_)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """(n,) whether each action reached the goal; False for one that could not be placed."""
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

    def __repr__(self) -> str:
        return f"<iplw.Rollouts {len(self)}: {self.valid.sum()} valid, {self.solved.sum()} solved>"


def encode(action: Action | ArrayLike, name: str = "action") -> int | list[float]:
    """An action as the wire has it: an index, or a list of finite numbers."""
    # The usual ones, and short: NumPy would take longer to look at them than the server to simulate them.
    numbers: Any = None
    if type(action) is np.ndarray and action.ndim == 1 and action.dtype.char in "efd":
        numbers = action.tolist()
    elif isinstance(action, list) and all([type(number) is float for number in action]):
        numbers = action
    if numbers is not None and all(map(math.isfinite, numbers)):
        return list(numbers)
    array = np.asarray(action)
    if array.ndim == 0 and np.issubdtype(array.dtype, np.integer):
        return int(array)
    if array.ndim != 1 or not (
        np.issubdtype(array.dtype, np.floating) or np.issubdtype(array.dtype, np.integer)
    ):
        raise ValueError(
            f"{name} is {action!r}; allowed: an index, or a vector of numbers from 0 to 1, one a component"
        )
    if not np.isfinite(array).all():
        raise ValueError(f"{name} is {action!r}; allowed: finite numbers from 0 to 1")
    values: list[float] = array.astype(np.float64).tolist()
    return values


def encode_all(actions: Sequence[Action] | NDArray[Any]) -> NDArray[Any] | list[int | list[float]]:
    """Many actions as the wire has them: an array if they are all indices or all vectors, else one by one."""
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
    """The results of a batch, whichever way they came."""
    results = answer["results"]
    if "states" in answer:
        return [_rollout(result, *_cut(answer, i)) for i, result in enumerate(results)]
    return [_rollout(result, *_columns(result)) for result in results]


_Track: TypeAlias = "tuple[NDArray[np.float64] | None, dict[str, NDArray[np.float64]]]"


def _cut(answer: Mapping[str, Any], i: int) -> _Track:
    """One trajectory out of the arrays of all: times (N, T), states (N, bodies, T, 3), lengths (N,)."""
    length = int(answer["length"][i])
    if not answer["results"][i]["valid"]:
        return None, {}
    states = answer["states"][i, :, :length]
    return answer["t"][i, :length], dict(zip(answer["bodies"], states))


def _columns(result: Mapping[str, Any]) -> _Track:
    """One trajectory out of lists."""
    t = result.get("t")
    return None if t is None else np.asarray(t, dtype=np.float64), {
        name: np.column_stack([np.asarray(track[key], dtype=np.float64) for key in ("x", "y", "angle")])
        for name, track in (result.get("bodies") or {}).items()
    }


def _rollout(
    result: Mapping[str, Any], t: NDArray[np.float64] | None, bodies: dict[str, NDArray[np.float64]]
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
    )
