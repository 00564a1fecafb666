"""A world on the server: reset, step, roll out batches, look."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import Problem, ServerUnavailable
from .handle import Handle
from .http import given, query

if TYPE_CHECKING:
    import pandas

#: One action: a vector in [0, 1], one number a component; or the index of a discrete action.
Action: TypeAlias = "int | Sequence[float] | NDArray[Any] | np.integer[Any]"

#: Most actions the server takes in one request.
MOST_ACTIONS = 4096
#: Seconds granted for each action of a batch, beyond the client's timeout.
_SLACK = 0.05


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


class World(Handle):
    """A handle on one world."""

    collection = "worlds"
    _closed = False

    @property
    def kind(self) -> str:
        """`sim` or `real`."""
        return str(self.data["kind"])

    @property
    def latents(self) -> dict[str, float] | None:
        """Density, friction and restitution; None if the world is sealed."""
        latents: dict[str, float] | None = self.data["latents"]
        return latents

    @property
    def interactions(self) -> int:
        """Valid attempts on this world so far; asks the server."""
        return int(self.refresh().data["interactions"])

    @property
    def dimension(self) -> int:
        """Numbers in an action vector."""
        return int(self.data["action_space"]["dimension"])

    @property
    def actions(self) -> int:
        """How many discrete actions there are."""
        return int(self.data["action_space"]["count"])

    def reset(
        self, *, seed: int | None = None, task: str | None = None, split: str | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Starts an episode on `task`, or on one drawn from `split` by `seed`: (observation, info)."""
        answer = self._http.call("POST", self._path("reset"), given(seed=seed, task=task, split=split))
        return np.asarray(answer["observation"], dtype=np.float64), answer["info"]

    def step(self, action: Action) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Acts once: (observation, reward, terminated, truncated, info).

        An action that cannot be placed leaves the episode open: `info["valid"]` is False and
        `info["reason"]` says why.
        """
        answer = self._http.call("POST", self._path("step"), {"action": encode(action)}, slack=1.0)
        return (
            np.asarray(answer["observation"], dtype=np.float64),
            float(answer["reward"]),
            bool(answer["terminated"]),
            bool(answer["truncated"]),
            answer["info"],
        )

    def rollout(
        self,
        actions: Sequence[Action] | NDArray[Any],
        *,
        task: str | None = None,
        trajectories: bool = False,
        stop: bool = True,
        batch: int = 1024,
    ) -> Rollouts:
        """Rolls out many actions on one task (default: the episode's), each from the start, as one batch.

        More than `batch` actions go out in several requests; if one is refused, those before it have
        happened. `stop=False` goes on after the goal is reached.
        """
        if not 1 <= batch <= MOST_ACTIONS:
            raise ValueError(f"batch is {batch}; allowed: 1 to {MOST_ACTIONS}")
        coded = [encode(action, f"actions[{i}]") for i, action in enumerate(actions)]
        results: list[Rollout] = []
        for start in range(0, len(coded), batch):
            part = coded[start : start + batch]
            body = {"actions": part, "trajectories": trajectories, "stop": stop, **given(task=task)}
            answer = self._http.call("POST", self._path("rollout"), body, slack=_SLACK * len(part))
            results.extend(_rollout(result) for result in answer["results"])
        return Rollouts(results)

    def set_latents(self, **latents: float) -> World:
        """Sets some of density (or mass), friction, restitution. A sealed world refuses with a `Problem`."""
        values = {name: float(value) for name, value in latents.items()}
        for name, value in values.items():
            if not np.isfinite(value):
                raise ValueError(f"{name} is {value}; allowed: a finite number")
        self.data = self._http.call("POST", self._path("set_latents"), values)
        return self

    def render(
        self,
        *,
        format: str = "png",
        view: str = "scene",
        action: Action | None = None,
        task: str | None = None,
        width: int | None = None,
    ) -> bytes:
        """A picture as PNG or SVG: the `scene`, or an action's `filmstrip` or `animation` (SVG only).

        Filming an action on a real world counts as an interaction.
        """
        code = None if action is None else encode(action)
        text = ",".join(map(repr, code)) if isinstance(code, list) else code
        values = query(format=format, view=view, action=text, task=task, width=width)
        return self._http.raw("GET", self._path("render") + values, slack=10.0, repeat=view == "scene")

    def close(self) -> None:
        """Deletes the world; a second call does nothing, nor does a world or server that is already gone."""
        if self._closed:
            return
        self._closed = True
        with suppress(ServerUnavailable):
            try:
                self._http.call("DELETE", self._path())
            except Problem as problem:
                if problem.status != 404:
                    raise

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def encode(action: Action | ArrayLike, name: str = "action") -> int | list[float]:
    """An action as the wire has it: an index, or a list of finite numbers."""
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


def _rollout(result: Mapping[str, Any]) -> Rollout:
    contacts = result.get("contacts") or {}
    t, bodies = result.get("t"), result.get("bodies") or {}
    return Rollout(
        valid=bool(result["valid"]),
        reason=result.get("reason"),
        solved=result.get("solved"),
        steps=int(result.get("steps") or 0),
        collisions=int(contacts.get("collisions") or 0),
        rolling_steps=int(contacts.get("rolling_steps") or 0),
        t=None if t is None else np.asarray(t, dtype=np.float64),
        bodies={
            name: np.column_stack([np.asarray(track[key], dtype=np.float64) for key in ("x", "y", "angle")])
            for name, track in bodies.items()
        },
    )
