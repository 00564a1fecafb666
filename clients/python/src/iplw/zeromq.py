"""ZeroMQ: a DEALER socket for each request under way, with raw arrays.

A socket connects once. When its connection breaks, it is thrown away and the next request makes a new one, so
nothing asked of a server that died is ever delivered to the one after it. While waiting, the server is pinged: it
may work for as long as the request is granted, but not be silent for longer than the timeout.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .errors import Problem, ServerUnavailable
from .operations import OPERATIONS, Call
from .transport import Transport, closed

try:
    import zmq
    import zmq.asyncio
    from zmq.utils.monitor import recv_monitor_message

    from . import codec, frames
except ImportError as error:
    raise ImportError(
        "tcp:// and ipc:// addresses need pyzmq and msgpack: pip install 'iplw[zmq]'; or use the http:// address"
    ) from error

#: How long a connection may take to be made, s, if the timeout is not shorter.
CONNECT = 10.0
#: Time between two looks whether the connection still stands, s.
LOOK = 0.1
#: Silence after which the server is pinged, s.
PING = 5.0
#: Repeats of what may be repeated after a lost connection.
REPEATS = 2
#: Connections kept for the next requests.
KEPT = 64
_ENDS = zmq.EVENT_DISCONNECTED | zmq.EVENT_CLOSED | zmq.EVENT_CONNECT_RETRIED
_FAILS = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL


class ZeroMq(Transport):
    """Sockets to one server, each used by one thread at a time."""

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        super().__init__(url, timeout, advice)
        self._lines: deque[_Line] = deque()
        self._numbers = itertools.count(1)
        self._pid = os.getpid()
        self._closed = False

    def send(self, call: Call[Any]) -> Any:
        """The answer, with arrays where they came raw; or its bytes."""
        repeats = REPEATS if call.repeatable else 0
        while True:
            try:
                return self._send(call)
            except Broken as broken:
                if repeats == 0:
                    raise self._broke(call.op) from broken
                repeats -= 1
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
            line.socket.send_multipart(message, copy=True)
            head, reply = self._await(line, number, call)
            result = frames.answer(head, reply, call.binary)
        except Problem:
            self._keep(line)
            raise
        except (zmq.ZMQError, ValueError) as error:
            line.close()
            if isinstance(error, zmq.ZMQError):
                raise Broken from error
            raise ServerUnavailable(
                f"{self.url} answered {call.op} with something else than this protocol ({error}); "
                "is it the ZeroMQ address of an iplw server?"
            ) from error
        except BaseException:
            # Somebody's Ctrl-C, too: what was asked is not wanted any more.
            line.abandon(number)
            raise
        self._keep(line)
        return result

    def _await(self, line: _Line, number: int, call: Call[Any]) -> tuple[dict[str, Any], list[bytes]]:
        now = time.monotonic()
        deadline, heard, pinged = now + self.timeout + call.slack, now, now
        while True:
            try:
                reply = line.socket.recv_multipart()
            except zmq.Again:
                now = time.monotonic()
                if line.broken():
                    raise Broken from None
                if now > deadline or now - heard > max(self.timeout, 2 * LOOK):
                    raise self._silent(call.op, now > deadline) from None
                if now - max(pinged, heard) > PING:
                    line.socket.send_multipart(frames.control(0, "ping"))
                    pinged = now
                continue
            head = frames.header(reply)
            # A refusal without an id is of a message that could not be read: ours, the only one under way.
            if head.get("id") in (number, None):
                return head, reply
            heard = time.monotonic()

    def _line(self) -> _Line:
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
            if not line.broken():
                return line
            line.close()
        made = _Line(self.url, min(LOOK, self.timeout))
        patience = min(self.timeout, CONNECT)
        if not made.established(patience):
            made.close()
            raise self._nobody(patience)
        return made

    def _keep(self, line: _Line) -> None:
        if self._closed or len(self._lines) >= KEPT:
            line.close()
        else:
            self._lines.append(line)

    def _nobody(self, patience: float) -> ServerUnavailable:
        return nobody(self.url, self._advice)

    def _broke(self, op: str) -> ServerUnavailable:
        return broke(self.url, op, self._advice)

    def _silent(self, op: str, overdue: bool) -> ServerUnavailable:
        return silent(self.url, op, self.timeout, self._advice)


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

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None) -> None:
        self._url = url
        self._timeout = timeout
        self._advice = advice
        self._loop = asyncio.get_running_loop()
        self._socket: Any = zmq.asyncio.Context.instance().socket(zmq.DEALER)
        self._monitor: Any = prepare(self._socket)
        self._waiting: dict[int, asyncio.Future[tuple[dict[str, Any], list[bytes]]]] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._broken = False
        self._heard = time.monotonic()

    @classmethod
    async def made(cls, url: str, timeout: float, advice: Callable[[], str] | None) -> AsyncZeroMq:
        """A connection that stands."""
        line = cls(url, timeout, advice)
        line._socket.connect(url)
        event: dict[str, Any] = {}
        with suppress(asyncio.TimeoutError):
            event = await asyncio.wait_for(recv_monitor_message(line._monitor), min(timeout, CONNECT))
        if event.get("event") != zmq.EVENT_HANDSHAKE_SUCCEEDED:
            line.close()
            raise nobody(url, advice)
        line._tasks = [asyncio.create_task(line._read()), asyncio.create_task(line._watch())]
        return line

    def usable(self) -> bool:
        """Whether it stands, and in this event loop."""
        return not self._broken and self._loop is asyncio.get_running_loop()

    async def send(self, number: int, call: Call[Any]) -> Any:
        """The answer to one call; a lost connection raises `Broken`."""
        future: asyncio.Future[tuple[dict[str, Any], list[bytes]]] = self._loop.create_future()
        self._waiting[number] = future
        answered = False
        try:
            await self._socket.send_multipart(frames.request(number, call))
            deadline = time.monotonic() + self._timeout + call.slack
            while not future.done():
                left = deadline - time.monotonic()
                await asyncio.wait([future], timeout=max(0.0, min(left, PING)))
                now = time.monotonic()
                if not future.done():
                    if now >= deadline or now - self._heard > max(self._timeout, 2 * PING):
                        raise silent(self._url, call.op, self._timeout, self._advice)
                    if now - self._heard > PING:
                        await self._socket.send_multipart(frames.control(0, "ping"))
            answered = True
            head, reply = future.result()
            return frames.answer(head, reply, call.binary)
        except zmq.ZMQError as error:
            raise Broken from error
        except ValueError as error:
            raise ServerUnavailable(f"{self._url} answered {call.op} with nonsense: {error}") from error
        finally:
            self._waiting.pop(number, None)
            if not answered and not self._broken:
                with suppress(zmq.ZMQError):
                    self._socket.send_multipart(frames.control(0, "cancel", request=number))

    def close(self) -> None:
        """Drops the connection; what is under way breaks."""
        self._end()
        for task in self._tasks:
            if self._loop.is_running():
                task.cancel()
        with suppress(zmq.ZMQError):
            self._socket.disable_monitor()
        self._monitor.close(0)
        self._socket.close(0)

    async def _read(self) -> None:
        while True:
            try:
                reply = await self._socket.recv_multipart()
                head = frames.header(reply)
            except zmq.ZMQError:
                return self._end()
            except ValueError:
                continue
            self._heard = time.monotonic()
            future = self._waiting.get(head.get("id") or 0)
            if future is not None and not future.done():
                future.set_result((head, reply))

    async def _watch(self) -> None:
        # After the handshake the monitor only ever speaks of an end.
        with suppress(zmq.ZMQError):
            await self._monitor.recv_multipart()
        self._end()

    def _end(self) -> None:
        self._broken = True
        for future in self._waiting.values():
            if not future.done():
                future.set_exception(Broken())


class Broken(Exception):
    """The connection ended before the answer came."""


class _Line:
    """One connection, never renewed."""

    def __init__(self, url: str, look: float) -> None:
        # The instance notices a fork and makes a context of the child's own.
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.RCVTIMEO, round(1000 * look))
        self._monitor: zmq.Socket[bytes] = prepare(self.socket)
        self.socket.connect(url)

    def established(self, patience: float) -> bool:
        """Waits until the connection stands; False if it cannot be made."""
        until = time.monotonic() + patience
        while self._monitor.poll(max(0, round(1000 * (until - time.monotonic())))):
            if recv_monitor_message(self._monitor)["event"] == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                return True
            break
        return False

    def broken(self) -> bool:
        """Whether the connection has ended."""
        # After the handshake the monitor only ever speaks of an end.
        return bool(int(self._monitor.getsockopt(zmq.EVENTS)) & zmq.POLLIN)

    def abandon(self, number: int) -> None:
        """Tells the server that the answer is not waited for, as far as that goes at once."""
        with suppress(zmq.ZMQError):
            self.socket.send_multipart(frames.control(0, "cancel", request=number), zmq.NOBLOCK)
        self.close(linger=100)

    def close(self, linger: int = 0) -> None:
        """Drops the connection."""
        with suppress(zmq.ZMQError):
            self.socket.disable_monitor()
        self._monitor.close(0)
        self.socket.close(linger)


def prepare(socket: Any) -> Any:
    """Sets a socket up to connect once; gives the monitor that tells of the connection."""
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.SNDTIMEO, 5000)
    # No queue for a server that is not there, and no second try behind our back.
    socket.setsockopt(zmq.IMMEDIATE, 1)
    socket.setsockopt(zmq.RECONNECT_IVL, -1)
    return socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | _ENDS | _FAILS)
