"""How many real interactions all sessions of a server may spend together."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Budget:
    """Counts real interactions over all sessions; safe among threads.

    Each session's world counts its own, but a session that ends takes its count along; this one stays for as long as
    the server runs.
    """

    def __init__(self, most: int | None = None) -> None:
        """`most`: interactions allowed; None for any number."""
        if most is not None and most < 0:
            raise ValueError(f"budget is {most}; allowed: a whole number from 0, or none")
        #: Interactions allowed; None for any number.
        self.most = most
        self._spent = 0
        self._lock = threading.Lock()

    @property
    def remaining(self) -> int | None:
        """Interactions left; None without a limit."""
        return None if self.most is None else self.most - self._spent

    @property
    def spent(self) -> int:
        """Interactions made, with those under way."""
        return self._spent

    @contextmanager
    def attempt(self) -> Iterator[Attempt]:
        """Holds one interaction while it is under way; `PermissionError` if none is left.

        It is given back if the attempt says that it did not count, and kept if nobody knows: an attempt that fails
        half-way may have happened.
        """
        with self._lock:
            if self.most is not None and self._spent >= self.most:
                raise PermissionError(
                    f"the budget of {self.most} real interactions, over all sessions of this server, is spent"
                )
            self._spent += 1
        made = Attempt()
        try:
            yield made
        finally:
            if not made.counts:
                with self._lock:
                    self._spent -= 1


class Attempt:
    """One interaction under way."""

    #: Whether it counts: it does unless it is known not to.
    counts = True
