"""What one operation of the server is, as far as a client must know."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Operation:
    """One operation: where HTTP has it, what it takes and gives."""

    method: str
    #: `/v1/worlds/{id}`; what stands in braces is taken from the arguments.
    path: str
    #: Status of success. 202 starts a job.
    status: int
    #: What it can be told: path parameters, query parameters and body fields together; `csv` or `body` for a whole one.
    names: tuple[str, ...] = ()
    #: Media types of its body; without any, what is not in the path goes into the query.
    takes: tuple[str, ...] = ()
    #: Media types of its answer.
    gives: tuple[str, ...] = ()
    #: Whether a key makes it happen once, however often it is asked for.
    keyed: bool = False
    #: What the answer calls its items, if it is a list in pages.
    items: str | None = None

    @property
    def placed(self) -> list[str]:
        """What must be given, as the path has a place for it."""
        return re.findall(r"{(\w+)}", self.path)

    @property
    def repeatable(self) -> bool:
        """Whether doing it again does no harm: reading and deleting may be sent again after a lost connection."""
        return self.method in ("GET", "DELETE")

    @property
    def binary(self) -> bool:
        """Whether the answer is bytes, never JSON."""
        return bool(self.gives) and "application/json" not in self.gives
