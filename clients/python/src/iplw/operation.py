"""Description of one operation of the server's API."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Operation:
    """One operation: route, arguments, media types."""

    method: str
    #: `/v1/worlds/{id}`; names in braces are path parameters.
    path: str
    #: Status of a successful response; 202 starts a job.
    status: int
    #: Names of path parameters, query parameters and body fields; `csv` or `body` for a body that is not an object.
    arguments: tuple[str, ...] = ()
    #: Media types of the request body; without one, arguments become query parameters.
    request_types: tuple[str, ...] = ()
    #: Media types of the response.
    response_types: tuple[str, ...] = ()
    #: Whether it accepts an idempotency key.
    accepts_key: bool = False
    #: Name of the array in a paginated response.
    list_field: str | None = None

    @property
    def path_parameters(self) -> list[str]:
        """Names of the path parameters."""
        return re.findall(r"{(\w+)}", self.path)

    @property
    def idempotent(self) -> bool:
        """Whether it can be retried after a lost connection: true for GET and DELETE, and for PATCH, which sets values."""
        return self.method in ("GET", "DELETE", "PATCH")

    @property
    def returns_bytes(self) -> bool:
        """Whether the response is bytes, never JSON."""
        return bool(self.response_types) and "application/json" not in self.response_types
