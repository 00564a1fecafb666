"""The calls behind the handles: what is asked, and how the answer is read. Nothing here waits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Protocol, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from .branching import finite
from .call import Call, given
from .film import Film
from .operations import OPERATIONS
from .ranked import Ranked, ranked
from .rollout import Action, Rollout, encode, encode_all, read_branch, read_rollouts
from .scene import Scene

#: Observation and info, as Gymnasium's reset gives them.
Start: TypeAlias = "tuple[NDArray[np.float64], dict[str, Any]]"
#: Observation, reward, terminated, truncated, info, as Gymnasium's step gives them.
Step: TypeAlias = "tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]"

#: Most actions the server takes in one request.
MOST_ACTIONS = 4096
#: Seconds granted for each action of a batch, beyond the client's timeout.
SLACK = 0.05


def get(op: str, id: str) -> Call[dict[str, Any]]:
    """What the server says about one resource."""
    return Call(op, {"id": id}, _same)


def reset(id: str, seed: int | None, task: str | None, split: str | None) -> Call[Start]:
    """Starts an episode."""
    return Call("reset_world", given(id=id, seed=seed, task=task, split=split), _start)


def step(id: str, action: Action) -> Call[Step]:
    """Acts once."""
    return Call("step_world", {"id": id, "action": encode(action)}, _step, slack=1.0)


def rollouts(
    id: str,
    actions: Sequence[Action] | NDArray[Any],
    task: str | None,
    trajectories: bool,
    stop: bool,
    batch: int,
    interventions: Sequence[Sequence[Mapping[str, Any]]] | None = None,
) -> list[Call[list[Rollout]]]:
    """Rolls out many actions, `batch` at a time."""
    if not 1 <= batch <= MOST_ACTIONS:
        raise ValueError(f"batch is {batch}; allowed: 1 to {MOST_ACTIONS}")
    coded = encode_all(actions)
    lists = None if interventions is None else [[dict(change) for change in own] for own in interventions]
    if lists is not None and len(lists) not in (1, len(coded)):
        raise ValueError(
            f"interventions has {len(lists)} lists; allowed: {len(coded)}, one for each action, or one for all of them"
        )

    def part(start: int) -> Call[list[Rollout]]:
        own = lists if lists is None or len(lists) == 1 else lists[start : start + batch]
        actions = coded[start : start + batch]
        more = {"trajectories": trajectories, "stop": stop, **given(task=task, interventions=own)}
        return Call(
            "rollout_world",
            {"id": id, "actions": actions, **more},
            read_rollouts,
            slack=SLACK * len(actions),
            raw=trajectories,
        )

    return [part(start) for start in range(0, len(coded), batch)]


def snapshot(
    id: str, of: Rollout | Action | None, at: float, task: str | None, stop: bool
) -> Call[dict[str, Any]]:
    """A moment of a rollout: of one that was seen, of an action's, or of the last step's."""
    args = {"id": id, "at": finite("at", at), "stop": stop, **given(task=task)}
    if isinstance(of, Rollout):
        if of.action is None:
            raise ValueError("this rollout does not know its action; ask for it with rollout(..., trajectories=True)")
        args |= {"action": of.action, "stop": of.stop, **given(task=task or of.task)}
        args |= given(interventions=list(of.interventions) or None)
    elif of is not None:
        args["action"] = encode(of)
    return Call("snapshot_world", args, _same)


def branch(id: str, snapshot: Mapping[str, Any], changes: Sequence[Mapping[str, Any]]) -> Call[Rollout]:
    """Goes on from a snapshot."""
    return Call("branch_world", {"id": id, "snapshot": snapshot, "interventions": changes}, read_branch)


def placed(
    rollout: Rollout, snapshot: Mapping[str, Any], changes: Sequence[Mapping[str, Any]], scene: Scene | None
) -> Rollout:
    """A branch's rollout with what it was made of, so that it can be branched again."""
    own = [{**change, "at": change.get("at", snapshot["at"])} for change in changes]
    return replace(
        rollout,
        action=list(snapshot["action"]),
        scene=scene,
        task=snapshot["task"],
        stop=snapshot["stop"],
        interventions=(*snapshot.get("interventions", ()), *own),
    )


def set_latents(id: str, latents: Mapping[str, float]) -> Call[dict[str, Any]]:
    """Sets some latent factors."""
    values = {name: float(value) for name, value in latents.items()}
    for name, value in values.items():
        if not np.isfinite(value):
            raise ValueError(f"{name} is {value}; allowed: a finite number")
    return Call("set_latents", {"id": id, **values}, _same)


def render(
    id: str,
    format: str | None,
    view: str,
    action: Action | None,
    task: str | None,
    width: int | None,
    fps: int | None,
) -> Call[bytes]:
    """A picture."""
    code = None if action is None else encode(action)
    text = ",".join(map(repr, code)) if isinstance(code, list) else code
    args = given(
        id=id,
        format=format,
        view=view,
        action=None if text is None else str(text),
        task=task,
        width=width,
        fps=fps,
    )
    # An action that is filmed is attempted.
    repeat = view == "scene" or action is None
    return Call("render_world", args, _same, slack=10.0, repeat=repeat, binary=True)


def film(id: str, width: int, fps: int) -> Call[Film]:
    """The step that was made last, frame by frame."""
    args = {"id": id, "view": "film", "width": width, "fps": fps}
    return Call("render_world", args, partial(Film, fps=fps), slack=30.0, binary=True)


def create_worlds(settings: Mapping[str, Any], count: int) -> Call[dict[str, Any]]:
    """Makes many worlds alike."""
    return Call("create_worlds", {**settings, "count": count}, _same, slack=SLACK * count)


def delete_worlds(worlds: Sequence[str]) -> Call[Any]:
    """Deletes worlds."""
    return Call("delete_worlds", {"worlds": worlds}, _same)


def reset_worlds(
    worlds: Sequence[str],
    seeds: Sequence[int | None],
    task: str | None,
    split: str | None,
    mask: NDArray[np.bool_] | None,
) -> Call[dict[str, Any]]:
    """Starts an episode in each world of the mask, by its seed or as its sequence of tasks goes on."""
    args: dict[str, Any] = {"worlds": worlds, **given(split=split, mask=mask)}
    if any(seed is not None for seed in seeds):
        args["seeds"] = seeds
    if task is not None:
        args["tasks"] = [task] * len(worlds)
    return Call("reset_worlds", args, _same, raw=True)


def step_worlds(
    worlds: Sequence[str],
    actions: NDArray[Any],
    autoreset: str,
    split: str | None,
) -> Call[dict[str, Any]]:
    """Acts once in each world; `split` is what those that are reset draw from."""
    args = {"worlds": worlds, "actions": actions, "autoreset": autoreset, **given(split=split)}
    return Call("step_worlds", args, _same, slack=SLACK * len(worlds), raw=True)


def act(id: str, task: str, count: int) -> Call[list[Ranked]]:
    """A policy's best actions."""
    return Call("act", {"id": id, "task": task, "count": count}, ranked, slack=10.0)


def weights(id: str) -> Call[bytes]:
    """A policy's weights."""
    return Call("download_weights", {"id": id}, _same, binary=True)


def draw(id: str) -> Call[bytes]:
    """A surface's picture."""
    return Call("draw_surface", {"id": id}, _same, binary=True)


def upload(id: str, data: bytes) -> Call[Any]:
    """Creates or replaces a policy."""
    return Call("upload_weights", {"id": id, "body": data}, _same)


def evaluate(id: str, world: str, split: str, attempts: int) -> Call[dict[str, Any]]:
    """A policy's score, as a job."""
    return Call(
        "evaluate_policy", {"id": id, "world": world, "split": split, "attempts": attempts}, _same
    )


def evaluate_ranking(world: str, ranking: Mapping[str, Any], attempts: int) -> Call[dict[str, Any]]:
    """The score of a policy outside the server: its actions by task, best first; as a job."""
    rows = [
        {"task": task, "actions": np.asarray(actions, dtype=np.float64).tolist()}
        for task, actions in ranking.items()
    ]
    args = {"id": "ranked", "world": world, "ranking": rows, "attempts": attempts}
    return Call("evaluate_policy", args, _same)


def proposals(id: str) -> Call[dict[str, Any]]:
    """What an estimation wants measured."""
    return Call("list_proposals", {"id": id}, _same, slack=10.0)


def tell(id: str, body: Mapping[str, Any], key: str) -> Call[dict[str, Any]]:
    """Tells an estimation what was measured."""
    return Call("tell_trials", {"id": id, **body}, _same, key=key, slack=10.0)


def cancel(id: str) -> Call[Any]:
    """Stops a job. Sent once: on a job that has ended it would make the server forget it."""
    return Call("delete_job", {"id": id}, _same, repeat=False)


def trials(id: str, format: str) -> Call[bytes]:
    """A job's trials as a file."""
    return Call("list_trials", {"id": id, "format": format}, _same, binary=True)


def task(id: str) -> Call[dict[str, Any]]:
    """One task by its id, `bowling:017`."""
    family, _, number = id.partition(":")
    return Call("get_task", {"family": family, "number": number}, _same)


def post(op: str, args: Mapping[str, Any], key: str | None = None) -> Call[dict[str, Any]]:
    """Any operation whose answer is taken as it comes."""
    return Call(op, args, _same, key=key)


def raw(op: str, args: Mapping[str, Any], key: str | None) -> Call[Any]:
    """Any operation of the table, with arguments it takes; else a `ValueError`."""
    if op not in OPERATIONS:
        raise ValueError(f"operation is {op!r}; allowed: {', '.join(sorted(OPERATIONS))}")
    operation = OPERATIONS[op]
    if unknown := sorted(set(args) - set(operation.names)):
        raise ValueError(f"{op} was given {unknown}; allowed: {', '.join(operation.names) or 'nothing'}")
    if missing := sorted(set(operation.placed) - set(args)):
        raise ValueError(f"{op} needs {', '.join(missing)}")
    if key is not None and not operation.keyed:
        raise ValueError(f"{op} was given a key; allowed: none, as it is not kept")
    # What the method promises does not hold of everything: some reading is counted, some deleting has two steps.
    return Call(op, args, _same, key=key, repeat=key is not None, binary=operation.binary)


def starting(op: str, args: Mapping[str, Any], key: str | None) -> Call[dict[str, Any]]:
    """The same of an operation that starts a job."""
    call = raw(op, args, key)
    if OPERATIONS[op].status != 202:
        starts = sorted(name for name, operation in OPERATIONS.items() if operation.status == 202)
        raise ValueError(f"{op} starts no job; allowed: {', '.join(starts)}")
    return call


class _Named(Protocol):
    @property
    def id(self) -> str: ...


@overload
def id_of(named: _Named | str) -> str: ...
@overload
def id_of(named: _Named | str | None) -> str | None: ...
def id_of(named: _Named | str | None) -> str | None:
    """The id of what a caller names, by a handle or the id itself."""
    return named if named is None or isinstance(named, str) else named.id


def _same(answer: Any) -> Any:
    return answer


def _start(answer: Any) -> Start:
    return np.asarray(answer["observation"], dtype=np.float64), answer["info"]


def _step(answer: Any) -> Step:
    return (
        np.asarray(answer["observation"], dtype=np.float64),
        float(answer["reward"]),
        bool(answer["terminated"]),
        bool(answer["truncated"]),
        answer["info"],
    )
