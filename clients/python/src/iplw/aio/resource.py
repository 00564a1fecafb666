"""Base class of resources on the server."""

from __future__ import annotations

from typing import Any, ClassVar

from typing_extensions import Self

from .. import requests
from ..display.page import card, table
from .connection import AsyncConnection

#: Nested fields that are displayed.
_NESTED_FIELDS = ("latents", "state", "training")


class AsyncResource:
    """One resource. `data` is its latest representation from the server."""

    #: Operation that reads the resource.
    _get_operation: ClassVar[str]

    def __init__(self, line: AsyncConnection, data: dict[str, Any]) -> None:
        self._connection = line
        self.data = data

    @property
    def id(self) -> str:
        """The resource's id."""
        return str(self.data["id"])

    async def refresh(self) -> Self:
        """Updates `data` from the server."""
        self.data = await self._connection.do(requests.get(self._get_operation, self.id))
        return self

    def _repr_html_(self) -> str:
        scalars = [(key, value) for key, value in self.data.items() if isinstance(value, (str, int, float))]
        nested = [(key, value) for key in _NESTED_FIELDS for value in [self.data.get(key)] if isinstance(value, dict)]
        rows = [*scalars, *((f"{key}.{name}", value) for key, part in nested for name, value in part.items())]
        return card(type(self).__name__.removeprefix("Async").lower(), table(["", ""], rows, max_rows=20), note=self.id)

    def __repr__(self) -> str:
        words = [self.id, *(str(self.data[key]) for key in ("kind", "state") if isinstance(self.data.get(key), str))]
        return f"<iplw.{type(self).__name__} {' '.join(words)}>"
