"""The connection of a client and its resources."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from typing import Any, TypeVar

from ..request import Request
from ..errors import Problem, ServerUnavailable
from ..operations import OPERATIONS
from ..runner import AsyncRunner
from ..transport import Event, Backoff, Transport, closed_error

T = TypeVar("T")
#: Items in one page of a list.
PAGE = 1000


class AsyncConnection:
    """A transport with a runner for its blocking calls."""

    def __init__(self, transport: Transport, runner: AsyncRunner) -> None:
        self.url = transport.url
        self._transport = transport
        self._runner = runner
        self._closed = False

    async def do(self, request: Request[T]) -> T:
        """Sends a request and parses the response.

        Raises `Problem` if the server rejects it, `ServerUnavailable` if there is no response. A busy server has not started
        the request; it is retried until the timeout.
        """
        backoff = None
        while True:
            if self._closed:
                raise closed_error()
            try:
                return request.read(await self._runner.send(self._transport, request))
            except Problem as problem:
                backoff = backoff or Backoff(self._transport.timeout)
                wait = backoff.delay(problem)
                if wait is None:
                    raise
                await self._runner.sleep(wait)

    async def items(self, op: str, **args: Any) -> list[Any]:
        """All items of a list, page by page."""
        items: list[Any] = []
        cursor: dict[str, Any] = {}
        while True:
            answer = await self.do(Request(op, {**args, "limit": PAGE, **cursor}, lambda answer: answer))
            items += answer[str(OPERATIONS[op].list_field)]
            if answer.get("next") is None:
                return items
            cursor = {"cursor": answer["next"]}

    async def forget(self, request: Request[Any]) -> None:
        """Sends a deletion; ignores a missing resource or server."""
        with suppress(ServerUnavailable):
            try:
                await self.do(request)
            except Problem as problem:
                if problem.status != 404:
                    raise

    def events(self, job: str, last_id: str, max_silence: float) -> AsyncGenerator[Event]:
        """A job's events after `last_id`; none if the transport has no events. See `Transport.events`."""
        return self._runner.read(self._transport.events(job, last_id, max_silence))

    async def run(self, work: Callable[[], T]) -> T:
        """Runs another blocking function."""
        return await self._runner.run(work)

    async def sleep(self, seconds: float) -> None:
        """Sleeps."""
        await self._runner.sleep(seconds)

    def close(self) -> None:
        """Closes the connections; idempotent."""
        self._closed = True
        self._transport.close()
        self._runner.close()
