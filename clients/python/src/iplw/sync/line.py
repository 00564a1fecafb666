# Made by `generate.py` from `aio/line.py`; change that.
"""What a client and its handles ask through."""

from __future__ import annotations

from collections.abc import Generator, Callable
from contextlib import suppress
from typing import Any, TypeVar

from ..call import Call
from ..errors import Problem, ServerUnavailable
from ..operations import OPERATIONS
from ..runner import Runner
from ..transport import Event, Pause, Transport, closed

T = TypeVar("T")
#: Items of a list asked for at a time.
PAGE = 1000


class Line:
    """A transport, and who waits for it."""

    def __init__(self, transport: Transport, runner: Runner) -> None:
        self.url = transport.url
        self._transport = transport
        self._runner = runner
        self._closed = False

    def do(self, call: Call[T]) -> T:
        """Carries one call out.

        A refusal raises `Problem`; no answer `ServerUnavailable`. A server that says it is busy has not begun, so
        it is asked again while the timeout lasts.
        """
        pause = None
        while True:
            if self._closed:
                raise closed()
            try:
                return call.read(self._runner.send(self._transport, call))
            except Problem as problem:
                pause = pause or Pause(self._transport.timeout)
                wait = pause.after(problem)
                if wait is None:
                    raise
                self._runner.sleep(wait)

    def items(self, op: str, **args: Any) -> list[Any]:
        """All items of a list, page by page."""
        found: list[Any] = []
        more: dict[str, Any] = {}
        while True:
            answer = self.do(Call(op, {**args, "limit": PAGE, **more}, lambda answer: answer))
            found += answer[str(OPERATIONS[op].items)]
            if answer.get("next") is None:
                return found
            more = {"cursor": answer["next"]}

    def forget(self, call: Call[Any]) -> None:
        """Deletes what may be gone already, with its server or without."""
        with suppress(ServerUnavailable):
            try:
                self.do(call)
            except Problem as problem:
                if problem.status != 404:
                    raise

    def events(self, job: str, last_id: str, patience: float) -> Generator[Event]:
        """A job's events after `last_id`; none where the transport has none. As `Transport.events`."""
        return self._runner.read(self._transport.events(job, last_id, patience))

    def run(self, work: Callable[[], T]) -> T:
        """Anything else that may take its time."""
        return self._runner.run(work)

    def sleep(self, seconds: float) -> None:
        """Waits."""
        self._runner.sleep(seconds)

    def close(self) -> None:
        """Drops the connections; a second call does nothing."""
        self._closed = True
        self._transport.close()
        self._runner.close()
