"""Who does what blocks: `Runner` the thread that asks, `AsyncRunner` threads beside the event loop.

This is the whole difference between the client that waits and the one that is awaited: everything above is written
once, in `aio`, and everything below blocks. Threads serve both transports, since neither urllib3 nor our protocol of
pings and deadlines over ZeroMQ has another form; a second one for asyncio would have to be kept equal to the first. A
thread costs a call about 0.1 ms, which waiting for worlds hides; whoever counts steps sends batches.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncGenerator, Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from .call import Call
from .transport import Event, Stream, Transport

T = TypeVar("T")


class Runner:
    """The thread that asks does it."""

    def send(self, transport: Transport, call: Call[Any]) -> Any:
        """`Transport.send`."""
        return transport.send(call)

    def read(self, stream: Stream | None) -> Generator[Event]:
        """The stream's events, if there is one; ends it when left."""
        if stream is None:
            return
        try:
            yield from stream
        finally:
            stream.stop()

    def run(self, work: Callable[[], T]) -> T:
        """Anything else that may take its time."""
        return work()

    def sleep(self, seconds: float) -> None:
        """Waits."""
        time.sleep(seconds)

    def close(self) -> None:
        """A second call does nothing."""


class AsyncRunner:
    """Threads do it, up to `concurrency` requests at once; more wait for their turn.

    A task that is cancelled stops waiting at once. Over ZeroMQ its thread is free again soon after, and the server is
    told; over HTTP the thread stays with the answer until it comes or the timeout ends.
    """

    def __init__(self, concurrency: int) -> None:
        if concurrency < 1:
            raise ValueError(f"concurrency is {concurrency}; allowed: 1 or more")
        self._threads = ThreadPoolExecutor(concurrency, "iplw-async")

    async def send(self, transport: Transport, call: Call[Any]) -> Any:
        """`Transport.send`."""
        given_up = threading.Event()
        try:
            return await asyncio.get_running_loop().run_in_executor(
                self._threads, transport.send, call, given_up
            )
        except asyncio.CancelledError:
            given_up.set()
            raise

    async def read(self, stream: Stream | None) -> AsyncGenerator[Event]:
        """The stream's events; ends it when left. It has a thread of its own, as it may be silent for long."""
        if stream is None:
            return
        loop, own = asyncio.get_running_loop(), ThreadPoolExecutor(1, "iplw-events")
        try:
            while (event := await loop.run_in_executor(own, next, stream, None)) is not None:
                yield event
        finally:
            stream.stop()
            own.shutdown(wait=False)

    async def run(self, work: Callable[[], T]) -> T:
        """Anything else that may take its time."""
        return await asyncio.to_thread(work)

    async def sleep(self, seconds: float) -> None:
        """Waits; the event loop goes on."""
        await asyncio.sleep(seconds)

    def close(self) -> None:
        """Lets the threads go as they finish; a second call does nothing."""
        self._threads.shutdown(wait=False, cancel_futures=True)
