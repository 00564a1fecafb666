"""What every handle on something the server keeps has in common."""

from __future__ import annotations

from typing import Any, ClassVar

from typing_extensions import Self

from . import calls
from .transport import Transport


class Named:
    """A handle on one resource. `data` is what the server last said about it."""

    #: The operation that asks for it.
    _look: ClassVar[str]

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data

    @property
    def id(self) -> str:
        """The resource's id."""
        return str(self.data["id"])

    def __repr__(self) -> str:
        words = [self.id, *(str(self.data[key]) for key in ("kind", "state") if isinstance(self.data.get(key), str))]
        return f"<iplw.{type(self).__name__} {' '.join(words)}>"


class Handle(Named):
    """A handle that waits for its answers."""

    def __init__(self, transport: Transport, data: dict[str, Any]) -> None:
        super().__init__(data)
        self._transport = transport

    def refresh(self) -> Self:
        """Looks again."""
        self.data = self._transport.do(calls.get(self._look, self.id))
        return self
