"""Budget of real interactions, shared by all sessions of a server."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager


class Budget:
    """Thread-safe counter of real interactions over all sessions.

    The worlds count their own interactions, but are deleted with their sessions; this counter lasts as long as the server.
    """

    def __init__(self, limit: int | None = None) -> None:
        """`limit`: maximum number of interactions; None for no limit."""
        if limit is not None and limit < 0:
            raise ValueError(f"budget is {limit}; allowed: an integer from 0, or none")
        #: Maximum number of interactions; None for no limit.
        self.limit = limit
        self._spent = 0
        self._lock = threading.Lock()

    @property
    def remaining(self) -> int | None:
        """Interactions left; None without a limit."""
        return None if self.limit is None else self.limit - self._spent

    @property
    def spent(self) -> int:
        """Interactions attempt, with those under way."""
        return self._spent

    @contextmanager
    def attempt(self) -> Iterator[Attempt]:
        """Reserves one interaction; `PermissionError` if none is left.

        It is released if the attempt is known not to count. An attempt that fails half-way may have been executed and
        stays counted.
        """
        with self._lock:
            if self.limit is not None and self._spent >= self.limit:
                raise PermissionError(
                    f"the budget of {self.limit} real interactions, over all sessions of this server, is spent"
                )
            self._spent += 1
        attempt = Attempt()
        try:
            yield attempt
        finally:
            if not attempt.counts:
                with self._lock:
                    self._spent -= 1


class Attempt:
    """One interaction in progress."""

    #: Whether it counts; False if it is known not to have been executed.
    counts = True
