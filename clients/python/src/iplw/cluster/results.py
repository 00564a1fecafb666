"""What comes back: values in the order of what was asked, and where each was computed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from .place import Ran

T = TypeVar("T")


class Results(list[T]):
    """A list of values, one an item, in the items' order.

    `items[i]` is what was asked, `ran[i]` where and how long it was computed (None where it failed).
    """

    def __init__(self, values: Iterable[T], items: Sequence[Any], ran: Sequence[Ran | None]) -> None:
        super().__init__(values)
        self.items = list(items)
        self.ran = list(ran)

    @property
    def kinds(self) -> list[tuple[str, ...]]:
        """The kinds of machines that computed: program, fused operations or none, C library."""
        return sorted({ran.machine.kind() for ran in self.ran if ran is not None})

    @property
    def alike(self) -> bool:
        """Whether all machines were of one kind: then bits are the same on any."""
        return len(self.kinds) <= 1
