"""What a client can ask for: one row an operation, named as in the OpenAPI document, for every transport."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Operation:
    """Where HTTP has it."""

    method: str
    #: `/v1/worlds/{id}`; what stands in braces is taken from the arguments.
    path: str

    @property
    def repeatable(self) -> bool:
        """Whether doing it again does no harm: reading and deleting may be sent again after a lost connection."""
        return self.method in ("GET", "DELETE")


@dataclass(slots=True)
class Call(Generic[T]):
    """One operation with its arguments, and how to read the answer."""

    op: str
    #: Path parameters, query parameters and body fields of the HTTP route, together.
    args: Mapping[str, Any]
    #: Makes what the caller gets of the answer.
    read: Callable[[Any], T]
    #: Makes the server carry the request out once, however often it arrives; it may then be repeated.
    key: str | None = None
    #: Seconds granted beyond the client's timeout.
    slack: float = 0.0
    #: False forbids repeating what the table allows.
    repeat: bool = True
    #: Whether numeric arrays of the answer are to come raw, where the transport can.
    raw: bool = False
    #: Whether the answer is bytes, given as they come.
    binary: bool = False

    @property
    def repeatable(self) -> bool:
        """Whether it may be sent again after a lost connection."""
        return self.repeat and (self.key is not None or OPERATIONS[self.op].repeatable)


OPERATIONS: dict[str, Operation] = {
    "healthz": Operation("GET", "/healthz"),
    "readyz": Operation("GET", "/readyz"),
    "list_worlds": Operation("GET", "/v1/worlds"),
    "create_world": Operation("POST", "/v1/worlds"),
    "get_world": Operation("GET", "/v1/worlds/{id}"),
    "delete_world": Operation("DELETE", "/v1/worlds/{id}"),
    "reset_world": Operation("POST", "/v1/worlds/{id}/reset"),
    "step_world": Operation("POST", "/v1/worlds/{id}/step"),
    "rollout_world": Operation("POST", "/v1/worlds/{id}/rollout"),
    "set_latents": Operation("POST", "/v1/worlds/{id}/set_latents"),
    "render_world": Operation("GET", "/v1/worlds/{id}/render"),
    "create_worlds": Operation("POST", "/v1/batch/worlds"),
    "delete_worlds": Operation("DELETE", "/v1/batch/worlds"),
    "reset_worlds": Operation("POST", "/v1/batch/reset"),
    "step_worlds": Operation("POST", "/v1/batch/step"),
    "list_families": Operation("GET", "/v1/tasks"),
    "list_tasks": Operation("GET", "/v1/tasks/{family}"),
    "get_task": Operation("GET", "/v1/tasks/{family}/{number}"),
    "start_iplw": Operation("POST", "/v1/iplw"),
    "list_proposals": Operation("GET", "/v1/iplw/{id}/proposals"),
    "tell_trials": Operation("POST", "/v1/iplw/{id}/trials"),
    "list_jobs": Operation("GET", "/v1/jobs"),
    "get_job": Operation("GET", "/v1/jobs/{id}"),
    "delete_job": Operation("DELETE", "/v1/jobs/{id}"),
    "list_trials": Operation("GET", "/v1/jobs/{id}/trials"),
    "list_policies": Operation("GET", "/v1/policies"),
    "train_policy": Operation("POST", "/v1/policies"),
    "get_policy": Operation("GET", "/v1/policies/{id}"),
    "delete_policy": Operation("DELETE", "/v1/policies/{id}"),
    "act": Operation("POST", "/v1/policies/{id}/act"),
    "evaluate_policy": Operation("POST", "/v1/policies/{id}/evaluate"),
    "download_weights": Operation("GET", "/v1/policies/{id}/weights"),
    "upload_weights": Operation("PUT", "/v1/policies/{id}/weights"),
    "start_diagnosis": Operation("POST", "/v1/diagnoses"),
    "learn_policy": Operation("POST", "/v1/policies/{id}/learn"),
    "list_surfaces": Operation("GET", "/v1/surfaces"),
    "find_surface": Operation("POST", "/v1/surfaces"),
    "get_surface": Operation("GET", "/v1/surfaces/{id}"),
    "delete_surface": Operation("DELETE", "/v1/surfaces/{id}"),
    "draw_surface": Operation("GET", "/v1/surfaces/{id}/picture"),
}


def given(**values: Any) -> dict[str, Any]:
    """The arguments that are not None: what a request says, the rest being the server's default."""
    return {key: value for key, value in values.items() if value is not None}
