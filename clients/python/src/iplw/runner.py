"""Runs blocking calls: `Runner` in the calling thread, `AsyncRunner` in a thread pool.

This is the only difference between the synchronous and the asynchronous client. The modules above are written once, in
`aio`; the modules below block. Threads serve both transports, because urllib3 has no asyncio interface and a second
implementation of the ZeroMQ protocol would have to be kept in step with the first. A thread adds about 0.1 ms to a
request; for many steps, send batches.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncGenerator, Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from .request import Request
from .transport import Event, Stream, Transport

T = TypeVar("T")


class Runner:
    """Runs blocking calls in the calling thread."""

    def send(self, transport: Transport, request: Request[Any]) -> Any:
        """`Transport.send`."""
        return transport.send(request)

    def read(self, stream: Stream | None) -> Generator[Event]:
        """The events of the stream, if any; stops the stream on exit."""
        if stream is None:
            return
        try:
            yield from stream
        finally:
            stream.stop()

    def run(self, work: Callable[[], T]) -> T:
        """Runs another blocking function."""
        return work()

    def sleep(self, seconds: float) -> None:
        """Sleeps."""
        time.sleep(seconds)

    def close(self) -> None:
        """Idempotent."""


class AsyncRunner:
    """Runs blocking calls in threads, at most `concurrency` requests at once; further requests wait.

    A cancelled task stops waiting at once. Over ZeroMQ the server is notified and the thread becomes free; over HTTP the
    thread is occupied until the response or the timeout.
    """

    def __init__(self, concurrency: int) -> None:
        if concurrency < 1:
            raise ValueError(f"concurrency is {concurrency}; allowed: 1 or more")
        self._threads = ThreadPoolExecutor(concurrency, "iplw-async")

    async def send(self, transport: Transport, request: Request[Any]) -> Any:
        """`Transport.send`."""
        cancelled = threading.Event()
        try:
            return await asyncio.get_running_loop().run_in_executor(
                self._threads, transport.send, request, cancelled
            )
        except asyncio.CancelledError:
            cancelled.set()
            raise

    async def read(self, stream: Stream | None) -> AsyncGenerator[Event]:
        """The events of the stream; stops the stream on exit. It uses its own thread, because events may be rare."""
        if stream is None:
            return
        loop, executor = asyncio.get_running_loop(), ThreadPoolExecutor(1, "iplw-events")
        try:
            while (event := await loop.run_in_executor(executor, next, stream, None)) is not None:
                yield event
        finally:
            stream.stop()
            executor.shutdown(wait=False)

    async def run(self, work: Callable[[], T]) -> T:
        """Runs another blocking function."""
        return await asyncio.to_thread(work)

    async def sleep(self, seconds: float) -> None:
        """Sleeps without blocking the event loop."""
        await asyncio.sleep(seconds)

    def close(self) -> None:
        """Shuts the threads down without waiting; idempotent."""
        self._threads.shutdown(wait=False, cancel_futures=True)
