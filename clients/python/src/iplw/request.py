"""A request: one operation with its arguments, independent of the transport."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from .operations import OPERATIONS

T = TypeVar("T")


@dataclass(slots=True)
class Request(Generic[T]):
    """One operation with its arguments and the parser of its response."""

    operation_id: str
    #: Path parameters, query parameters and body fields of the HTTP route, together.
    args: Mapping[str, Any]
    #: Parses the response.
    read: Callable[[Any], T]
    #: Idempotency key: the server executes the request once, so it can be retried.
    key: str | None = None
    #: Added to the client's timeout, s.
    extra_timeout_s: float = 0.0
    #: False disables retries of an idempotent operation.
    allow_retry: bool = True
    #: Whether to request numeric arrays as raw bytes, if the transport supports them.
    raw_arrays: bool = False
    #: Whether the response is returned as bytes.
    returns_bytes: bool = False

    @property
    def can_retry(self) -> bool:
        """Whether the request can be retried after a lost connection."""
        return self.allow_retry and (self.key is not None or OPERATIONS[self.operation_id].idempotent)


def drop_none(**values: Any) -> dict[str, Any]:
    """The arguments that are not None; the server has defaults for the others."""
    return {key: value for key, value in values.items() if value is not None}
