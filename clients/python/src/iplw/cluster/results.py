"""Results of a sweep, with the machines that computed them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from .machine import Ran

T = TypeVar("T")


class Results(list[T]):
    """A list of values, one for each item, in the order of the items.

    `items[i]` is the input; `ran[i]` says where and how long it was computed (None if it failed).
    """

    def __init__(self, values: Iterable[T], items: Sequence[Any], ran: Sequence[Ran | None]) -> None:
        super().__init__(values)
        self.items = list(items)
        self.ran = list(ran)

    @property
    def kinds(self) -> list[tuple[str, ...]]:
        """Kinds of machines used: program, architecture with or without FMA, C library."""
        return sorted({ran.machine.kind() for ran in self.ran if ran is not None})

    @property
    def alike(self) -> bool:
        """Whether all machines were of one kind, so that results are bit-reproducible on any of them."""
        return len(self.kinds) <= 1
