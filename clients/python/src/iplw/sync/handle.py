# Made by `generate.py` from `aio/handle.py`; change that.
"""What every handle on something the server keeps has in common."""

from __future__ import annotations

from typing import Any, ClassVar

from typing_extensions import Self

from .. import calls
from ..show.page import card, table
from .line import Line

#: Parts that are shown with what they hold.
_SHOWN = ("latents", "state", "training")


class Handle:
    """A handle on one resource. `data` is what the server last said about it."""

    #: The operation that asks for it.
    _look: ClassVar[str]

    def __init__(self, line: Line, data: dict[str, Any]) -> None:
        self._line = line
        self.data = data

    @property
    def id(self) -> str:
        """The resource's id."""
        return str(self.data["id"])

    def refresh(self) -> Self:
        """Looks again."""
        self.data = self._line.do(calls.get(self._look, self.id))
        return self

    def _repr_html_(self) -> str:
        plain = [(key, value) for key, value in self.data.items() if isinstance(value, (str, int, float))]
        inside = [(key, value) for key in _SHOWN for value in [self.data.get(key)] if isinstance(value, dict)]
        rows = [*plain, *((f"{key}.{name}", value) for key, part in inside for name, value in part.items())]
        return card(type(self).__name__.removeprefix("Async").lower(), table(["", ""], rows, most=20), note=self.id)

    def __repr__(self) -> str:
        words = [self.id, *(str(self.data[key]) for key in ("kind", "state") if isinstance(self.data.get(key), str))]
        return f"<iplw.{type(self).__name__} {' '.join(words)}>"
