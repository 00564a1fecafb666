"""A call: one operation with its arguments, for every transport."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from .operations import OPERATIONS

T = TypeVar("T")


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


def given(**values: Any) -> dict[str, Any]:
    """The arguments that are not None: what a request says, the rest being the server's default."""
    return {key: value for key, value in values.items() if value is not None}
