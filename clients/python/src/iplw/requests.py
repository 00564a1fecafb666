"""Builders of the requests that resources send, with the parsers of their responses. No I/O."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Protocol, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from .branching import finite
from .request import Request, drop_none
from .film import Film
from .operations import OPERATIONS
from .ranking import Ranked, read_ranking
from .rollout import Action, Rollout, encode, encode_all, read_branch, read_rollouts
from .scene import Scene

#: Observation and info, as returned by Gymnasium's `reset`.
Start: TypeAlias = "tuple[NDArray[np.float64], dict[str, Any]]"
#: Observation, reward, terminated, truncated, info, as returned by Gymnasium's `step`.
Step: TypeAlias = "tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]"

#: Maximum number of actions in one request.
MAX_ACTIONS = 4096
#: Added to the client's timeout for each action of a batch, s.
EXTRA_S_PER_ACTION = 0.05


def get(op: str, id: str) -> Request[dict[str, Any]]:
    """Reads or deletes one resource by its id."""
    return Request(op, {"id": id}, _identity)


def reset(id: str, seed: int | None, task: str | None, split: str | None) -> Request[Start]:
    """Starts an episode."""
    return Request("reset_world", drop_none(id=id, seed=seed, task=task, split=split), _start)


def step(id: str, action: Action, episode: int | None) -> Request[Step]:
    """Executes one action of an episode, by its number; None: the current one."""
    args = {"id": id, "action": encode(action), **drop_none(episode=episode)}
    return Request("step_world", args, _step, extra_timeout_s=1.0)


def rollouts(
    id: str,
    actions: Sequence[Action] | NDArray[Any],
    task: str | None,
    trajectories: bool,
    stop: bool,
    batch: int,
    interventions: Sequence[Sequence[Mapping[str, Any]]] | None = None,
) -> list[Request[list[Rollout]]]:
    """Rolls out many actions, at most `batch` in one request."""
    if not 1 <= batch <= MAX_ACTIONS:
        raise ValueError(f"batch is {batch}; allowed: 1 to {MAX_ACTIONS}")
    encoded = encode_all(actions)
    lists = None if interventions is None else [[dict(change) for change in changes] for changes in interventions]
    if lists is not None and len(lists) not in (1, len(encoded)):
        raise ValueError(
            f"interventions has {len(lists)} lists; allowed: {len(encoded)}, one for each action, or one for all of them"
        )

    def batch_request(start: int) -> Request[list[Rollout]]:
        selected = lists if lists is None or len(lists) == 1 else lists[start : start + batch]
        actions = encoded[start : start + batch]
        options = {"trajectories": trajectories, "stop": stop, **drop_none(task=task, interventions=selected)}
        return Request(
            "rollout_world",
            {"id": id, "actions": actions, **options},
            read_rollouts,
            extra_timeout_s=EXTRA_S_PER_ACTION * len(actions),
            raw_arrays=trajectories,
        )

    return [batch_request(start) for start in range(0, len(encoded), batch)]


def snapshot(
    id: str, of: Rollout | Action | None, at: float, task: str | None, stop: bool
) -> Request[dict[str, Any]]:
    """A snapshot of a rollout at one time: of a given rollout, of an action, or of the last step."""
    args = {"id": id, "at": finite("at", at), "stop": stop, **drop_none(task=task)}
    if isinstance(of, Rollout):
        if of.action is None:
            raise ValueError("this rollout has no action; create it with rollout(..., trajectories=True)")
        args |= {"action": of.action, "stop": of.stop, **drop_none(task=task or of.task)}
        args |= drop_none(interventions=list(of.interventions) or None)
    elif of is not None:
        args["action"] = encode(of)
    return Request("snapshot_world", args, _identity)


def branch(id: str, snapshot: Mapping[str, Any], changes: Sequence[Mapping[str, Any]]) -> Request[Rollout]:
    """Continues from a snapshot with interventions."""
    return Request("branch_world", {"id": id, "snapshot": snapshot, "interventions": changes}, read_branch)


def with_branch_context(
    rollout: Rollout, snapshot: Mapping[str, Any], changes: Sequence[Mapping[str, Any]], scene: Scene | None
) -> Rollout:
    """A branch's rollout with its action, scene and interventions, so that it can be branched again."""
    changes_at = [{**change, "at": change.get("at", snapshot["at"])} for change in changes]
    return replace(
        rollout,
        action=list(snapshot["action"]),
        scene=scene,
        task=snapshot["task"],
        stop=snapshot["stop"],
        interventions=(*snapshot.get("interventions", ()), *changes_at),
    )


def set_latents(id: str, latents: Mapping[str, float]) -> Request[dict[str, Any]]:
    """Sets some latent factors."""
    values = {name: float(value) for name, value in latents.items()}
    for name, value in values.items():
        if not np.isfinite(value):
            raise ValueError(f"{name} is {value}; allowed: a finite number")
    return Request("set_latents", {"id": id, **values}, _identity)


def render(
    id: str,
    format: str | None,
    view: str,
    action: Action | None,
    task: str | None,
    width: int | None,
    fps: int | None,
) -> Request[bytes]:
    """Renders a picture."""
    code = None if action is None else encode(action)
    text = ",".join(map(repr, code)) if isinstance(code, list) else code
    args = drop_none(
        id=id,
        format=format,
        view=view,
        action=None if text is None else str(text),
        task=task,
        width=width,
        fps=fps,
    )
    # Rendering an action executes it, which may count as an interaction.
    repeat = view == "scene" or action is None
    return Request("render_world", args, _identity, extra_timeout_s=10.0, allow_retry=repeat, returns_bytes=True)


def film(id: str, width: int, fps: int) -> Request[Film]:
    """The film of the last step."""
    args = {"id": id, "view": "film", "width": width, "fps": fps}
    return Request("render_world", args, partial(Film, fps=fps), extra_timeout_s=30.0, returns_bytes=True)


def create_worlds(settings: Mapping[str, Any], count: int) -> Request[dict[str, Any]]:
    """Creates many worlds with the same settings."""
    return Request("create_worlds", {**settings, "count": count}, _identity, extra_timeout_s=EXTRA_S_PER_ACTION * count)


def delete_worlds(worlds: Sequence[str]) -> Request[Any]:
    """Deletes worlds."""
    return Request("delete_worlds", {"worlds": worlds}, _identity)


def reset_worlds(
    worlds: Sequence[str],
    seeds: Sequence[int | None],
    task: str | None,
    split: str | None,
    mask: NDArray[np.bool_] | None,
) -> Request[dict[str, Any]]:
    """Starts an episode in each world of the mask; a world without a seed continues its sequence of tasks."""
    args: dict[str, Any] = {"worlds": worlds, **drop_none(split=split, mask=mask)}
    if any(seed is not None for seed in seeds):
        args["seeds"] = seeds
    if task is not None:
        args["tasks"] = [task] * len(worlds)
    return Request("reset_worlds", args, _identity, raw_arrays=True)


def step_worlds(
    worlds: Sequence[str],
    actions: NDArray[Any],
    autoreset: str,
    split: str | None,
) -> Request[dict[str, Any]]:
    """Executes one action in each world; worlds that are reset sample a task from `split`."""
    args = {"worlds": worlds, "actions": actions, "autoreset": autoreset, **drop_none(split=split)}
    return Request("step_worlds", args, _identity, extra_timeout_s=EXTRA_S_PER_ACTION * len(worlds), raw_arrays=True)


def control(op: str, id: str, count: int, **args: Any) -> Request[dict[str, Any]]:
    """Resets, steps or rolls out `count` motions of a control world."""
    named = drop_none(id=id, **{name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in args.items()})
    return Request(op, named, _identity, extra_timeout_s=EXTRA_S_PER_ACTION * count, raw_arrays=True)


def render_control(id: str, environment: int, width: int) -> Request[bytes]:
    """Draws an environment of a control world."""
    args = {"id": id, "environment": environment, "width": width}
    return Request("render_control_world", args, _identity, extra_timeout_s=10.0, returns_bytes=True)


def act(id: str, task: str, count: int) -> Request[list[Ranked]]:
    """The highest-ranked actions of a policy."""
    return Request("act", {"id": id, "task": task, "count": count}, read_ranking, extra_timeout_s=10.0)


def weights(id: str) -> Request[bytes]:
    """The weights of a policy."""
    return Request("download_weights", {"id": id}, _identity, returns_bytes=True)


def report(id: str) -> Request[bytes]:
    """The report of a job's result as HTML."""
    return Request("get_report", {"id": id}, _identity, returns_bytes=True)


def draw(id: str) -> Request[bytes]:
    """The heat map of a surface."""
    return Request("draw_surface", {"id": id}, _identity, returns_bytes=True)


def upload(id: str, data: bytes) -> Request[Any]:
    """Creates or replaces a policy."""
    return Request("upload_weights", {"id": id, "body": data}, _identity)


def evaluate(id: str, world: str, split: str, attempts: int) -> Request[dict[str, Any]]:
    """Evaluates a policy, as a job."""
    return Request(
        "evaluate_policy", {"id": id, "world": world, "split": split, "attempts": attempts}, _identity
    )


def evaluate_ranking(world: str, ranking: Mapping[str, Any], attempts: int) -> Request[dict[str, Any]]:
    """Evaluates an external policy from its ranked actions by task, best first; as a job."""
    rows = [
        {"task": task, "actions": np.asarray(actions, dtype=np.float64).tolist()}
        for task, actions in ranking.items()
    ]
    args = {"id": "ranked", "world": world, "ranking": rows, "attempts": attempts}
    return Request("evaluate_policy", args, _identity)


def proposals(id: str) -> Request[dict[str, Any]]:
    """The pending proposals of an estimation."""
    return Request("list_proposals", {"id": id}, _identity, extra_timeout_s=10.0)


def tell(id: str, body: Mapping[str, Any], key: str) -> Request[dict[str, Any]]:
    """Submits measured trials to an estimation."""
    return Request("submit_trials", {"id": id, **body}, _identity, key=key, extra_timeout_s=10.0)


def annotate(id: str, name: str | None = None, note: str | None = None) -> Request[dict[str, Any]]:
    """Sets the name and the note of a job, each unless it is None."""
    return Request("update_job", drop_none(id=id, name=name, note=note), _identity)


def cancel(id: str) -> Request[Any]:
    """Cancels a job. Never retried: repeated on an ended job, the request would delete it."""
    return Request("delete_job", {"id": id}, _identity, allow_retry=False)


def trials(id: str, format: str) -> Request[bytes]:
    """A job's trials as a file."""
    return Request("list_trials", {"id": id, "format": format}, _identity, returns_bytes=True)


def task(id: str) -> Request[dict[str, Any]]:
    """One task by its id (`bowling:017`)."""
    family, _, number = id.partition(":")
    return Request("get_task", {"family": family, "number": number}, _identity)


def post(op: str, args: Mapping[str, Any], key: str | None = None) -> Request[dict[str, Any]]:
    """An operation whose response is returned unparsed."""
    return Request(op, args, _identity, key=key)


def any_operation(op: str, args: Mapping[str, Any], key: str | None) -> Request[Any]:
    """Any operation, with its arguments checked; `ValueError` for an unknown operation or argument."""
    if op not in OPERATIONS:
        raise ValueError(f"operation is {op!r}; allowed: {', '.join(sorted(OPERATIONS))}")
    operation = OPERATIONS[op]
    if unknown := sorted(set(args) - set(operation.arguments)):
        raise ValueError(f"{op} does not accept {unknown}; allowed: {', '.join(operation.arguments) or 'nothing'}")
    if missing := sorted(set(operation.path_parameters) - set(args)):
        raise ValueError(f"{op} needs {', '.join(missing)}")
    if key is not None and not operation.accepts_key:
        raise ValueError(f"{op} does not accept a key; leave `key` out")
    # GET and DELETE are not always idempotent here: some reads count as interactions, some deletions have two stages.
    return Request(op, args, _identity, key=key, allow_retry=key is not None, returns_bytes=operation.returns_bytes)


def job_operation(op: str, args: Mapping[str, Any], key: str | None) -> Request[dict[str, Any]]:
    """As `any_operation`, for operations that start a job."""
    request = any_operation(op, args, key)
    if OPERATIONS[op].status != 202:
        job_operations = sorted(name for name, operation in OPERATIONS.items() if operation.status == 202)
        raise ValueError(f"{op} does not start a job; allowed: {', '.join(job_operations)}")
    return request


class _HasId(Protocol):
    @property
    def id(self) -> str: ...


@overload
def id_of(resource: _HasId | str) -> str: ...
@overload
def id_of(resource: _HasId | str | None) -> str | None: ...
def id_of(resource: _HasId | str | None) -> str | None:
    """The id of a resource that is given as an object or by its id."""
    return resource if resource is None or isinstance(resource, str) else resource.id


def _identity(answer: Any) -> Any:
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
