"""ZeroMQ: a connection for each request under way, with raw arrays.

A connection is made once. When its connection breaks, it is thrown away and the next request makes a new one, so
nothing asked of a server that died is ever delivered to the one after it. While waiting, the server is pinged: it
may work for as long as the request is granted, but not be silent for longer than the timeout.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from .errors import Problem, ServerUnavailable
from .operations import OPERATIONS, Call
from .transport import Transport, closed

try:
    from . import frames, zmtp
except ImportError as error:
    raise ImportError(
        "tcp:// and ipc:// addresses need msgpack: pip install 'iplw[zmq]'; or use the http:// address"
    ) from error

Broken = zmtp.Broken
#: How long a connection may take to be made, s, if the timeout is not shorter.
CONNECT = 10.0
#: Time between two looks at the clock while waiting, s.
LOOK = 0.1
#: Silence after which the server is pinged, s.
PING = 5.0
#: How long the server may not take what is sent, s.
SENDING = 5.0
#: Repeats of what may be repeated after a lost connection.
REPEATS = 2
#: Connections kept for the next requests.
KEPT = 64


class ZeroMq(Transport):
    """Sockets to one server, each used by one thread at a time."""

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        super().__init__(url, timeout, advice)
        self._lines: deque[zmtp.Connection] = deque()
        self._numbers = itertools.count(1)
        self._pid = os.getpid()
        self._closed = False

    def send(self, call: Call[Any]) -> Any:
        """The answer, with arrays where they came raw; or its bytes."""
        repeats = 0
        while True:
            try:
                return self._send(call)
            except Broken as broken:
                if repeats == REPEATS or not call.repeatable:
                    raise broke(self.url, call.op, self._advice) from broken
                repeats += 1
                time.sleep(0.1)

    def close(self) -> None:
        """Drops the connections; a second call does nothing."""
        self._closed = True
        while self._lines:
            self._lines.pop().close()

    def _send(self, call: Call[Any]) -> Any:
        number = next(self._numbers)
        message = frames.request(number, call)
        line = self._line()
        try:
            line.send(message)
            head, reply = self._await(line, number, call)
            result = frames.answer(head, reply, call.binary)
        except Problem:
            self._keep(line)
            raise
        except OSError as error:
            line.close()
            raise Broken from error
        except ValueError as error:
            line.close()
            raise ServerUnavailable(
                f"{self.url} answered {call.op} with something else than this protocol ({error}); "
                "is it the ZeroMQ address of an iplw server?"
            ) from error
        except BaseException:
            # Somebody's Ctrl-C, too: what was asked is not wanted any more.
            _abandon(line, number)
            raise
        self._keep(line)
        return result

    def _await(self, line: zmtp.Connection, number: int, call: Call[Any]) -> tuple[dict[str, Any], list[Any]]:
        asked = heard = pinged = time.monotonic()
        while True:
            try:
                reply = line.receive()
            except TimeoutError:
                now = time.monotonic()
                overdue = now > asked + self.timeout + call.slack
                if overdue or now - heard > max(self.timeout, 2 * LOOK):
                    raise silent(self.url, call.op, self.timeout, self._advice) from None
                if now - max(pinged, heard) > PING:
                    line.send(frames.control(0, "ping"))
                    pinged = now
                continue
            head = frames.header(reply)
            # A refusal without an id is of a message that could not be read: ours, the only one under way.
            if head.get("id") in (number, None):
                return head, reply
            heard = time.monotonic()

    def _line(self) -> zmtp.Connection:
        if self._closed:
            raise closed()
        if self._pid != os.getpid():
            # A forked child must not talk over its parent's sockets.
            self._lines, self._pid = deque(), os.getpid()
        while True:
            try:
                line = self._lines.pop()
            except IndexError:
                break
            if not line.dropped():
                return line
            line.close()
        try:
            made = zmtp.Connection(self.url, min(self.timeout, CONNECT))
        except (OSError, zmtp.Nonsense) as error:
            raise nobody(self.url, self._advice) from error
        made.wait_for(min(LOOK, self.timeout), SENDING)
        return made

    def _keep(self, line: zmtp.Connection) -> None:
        if self._closed or len(self._lines) >= KEPT:
            line.close()
        else:
            self._lines.append(line)


def _abandon(line: zmtp.Connection, number: int) -> None:
    """Tells the server that the answer is not waited for, and hangs up."""
    if line.whole:
        with suppress(OSError):
            line.send(frames.control(0, "cancel", request=number))
    line.close()


def nobody(url: str, advice: Callable[[], str] | None) -> ServerUnavailable:
    """Nobody listens there."""
    todo = (advice() if advice else "") or (
        "start one with `iplw serve --zmq ADDRESS`, check the address, or leave `url` out to get a private server"
    )
    return ServerUnavailable(f"no iplw server at {url}; {todo}")


def broke(url: str, op: str, advice: Callable[[], str] | None) -> ServerUnavailable:
    """The connection was lost."""
    doubt = "" if OPERATIONS[op].repeatable else "; what was asked may or may not have happened"
    todo = (advice() if advice else "") or f"check whether the server still runs{doubt}"
    return ServerUnavailable(f"the connection to {url} broke during {op}; {todo}")


def silent(url: str, op: str, timeout: float, advice: Callable[[], str] | None) -> ServerUnavailable:
    """No answer came in time."""
    todo = (advice() if advice else "") or (
        "give it longer with iplw.Client(timeout=...), or ask for less at once"
    )
    return ServerUnavailable(f"no answer to {op} from {url} within {timeout:g} s; {todo}")


class AsyncZeroMq:
    """One connection for asyncio, never renewed; carries any number of requests at once."""

    def __init__(
        self,
        url: str,
        timeout: float,
        advice: Callable[[], str] | None,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        self._url = url
        self._timeout = timeout
        self._advice = advice
        self._loop = asyncio.get_running_loop()
        self._reader = reader
        self._writer = writer
        self._waiting: dict[int, asyncio.Future[tuple[dict[str, Any], list[Any]]]] = {}
        self._reading: asyncio.Task[None] | None = None
        self._broken = False
        self._heard = time.monotonic()

    @classmethod
    async def made(cls, url: str, timeout: float, advice: Callable[[], str] | None) -> AsyncZeroMq:
        """A connection that stands."""
        try:
            reader, writer = await asyncio.wait_for(zmtp.opened(url), min(timeout, CONNECT))
        except (OSError, EOFError, ValueError, asyncio.TimeoutError) as error:
            raise nobody(url, advice) from error
        line = cls(url, timeout, advice, reader, writer)
        line._reading = asyncio.create_task(line._read())
        return line

    def usable(self) -> bool:
        """Whether it stands, and in this event loop."""
        return not self._broken and self._loop is asyncio.get_running_loop()

    async def send(self, number: int, call: Call[Any]) -> Any:
        """The answer to one call; a lost connection raises `Broken`."""
        future: asyncio.Future[tuple[dict[str, Any], list[Any]]] = self._loop.create_future()
        message = frames.request(number, call)
        self._waiting[number] = future
        answered = False
        try:
            await self._say(message)
            deadline = time.monotonic() + self._timeout + call.slack
            while not future.done():
                left = deadline - time.monotonic()
                await asyncio.wait([future], timeout=max(0.0, min(left, PING)))
                now = time.monotonic()
                if not future.done():
                    if now >= deadline or now - self._heard > max(self._timeout, 2 * PING):
                        raise silent(self._url, call.op, self._timeout, self._advice)
                    if now - self._heard > PING:
                        await self._say(frames.control(0, "ping"))
            answered = True
            head, reply = future.result()
            return frames.answer(head, reply, call.binary)
        except OSError as error:
            raise Broken from error
        except ValueError as error:
            raise ServerUnavailable(f"{self._url} answered {call.op} with nonsense: {error}") from error
        finally:
            self._waiting.pop(number, None)
            if not answered and not self._broken:
                self._put(frames.control(0, "cancel", request=number))

    def close(self) -> None:
        """Drops the connection; what is under way breaks."""
        self._end()
        if self._reading is not None and self._loop.is_running():
            self._reading.cancel()
        with suppress(RuntimeError):
            # Its loop may have gone before it.
            self._writer.close()

    async def _say(self, message: Sequence[Any]) -> None:
        if self._broken:
            raise Broken
        self._put(message)
        await self._writer.drain()

    def _put(self, message: Sequence[Any]) -> None:
        # A message is written whole before anybody else's turn comes.
        for piece in zmtp.pieces(message):
            self._writer.write(piece)

    async def _read(self) -> None:
        try:
            while True:
                reply = await zmtp.receive(self._reader, self._writer)
                self._heard = time.monotonic()
                try:
                    head = frames.header(reply)
                except ValueError:
                    continue
                future = self._waiting.get(head.get("id") or 0)
                if future is not None and not future.done():
                    future.set_result((head, reply))
        except (OSError, EOFError, ValueError):
            self._end()
            self._writer.close()

    def _end(self) -> None:
        self._broken = True
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(Broken())
