"""ZeroMQ by pyzmq: a DEALER socket for each request under way, with raw arrays. The fast way to single steps.

A socket connects once. When its connection breaks, it is thrown away and the next request makes a new one, so
nothing asked of a server that died is ever delivered to the one after it. While waiting, the server is pinged: it
may work for as long as the request is granted, but not be silent for longer than the timeout.
"""

from __future__ import annotations

import itertools
import os
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .call import Call
from .errors import Problem
from .transport import CONNECT, KEPT, Lost, Transport, closed

try:
    import zmq
    from zmq.utils.monitor import recv_monitor_message

    from . import frames
except ImportError as error:
    raise ImportError(
        "tcp:// and ipc:// addresses need pyzmq and msgpack: pip install 'iplw[zmq]'; or use the http:// address"
    ) from error

#: Time between two looks at the clock, the connection and whether the answer is still wanted, s.
LOOK = 0.1
#: Silence after which the server is pinged, s.
PING = 5.0
#: How long a request that is given up may take to be told of while its socket closes, s.
FAREWELL = 0.1
_BEGINS = zmq.EVENT_HANDSHAKE_SUCCEEDED
_ENDS = (
    zmq.EVENT_DISCONNECTED
    | zmq.EVENT_CLOSED
    | zmq.EVENT_CONNECT_RETRIED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
)


class ZeroMq(Transport):
    """Sockets to one server, each used by one thread at a time."""

    _start = "iplw serve --zmq ADDRESS"
    _what = "the ZeroMQ address of an iplw server"

    def __init__(
        self,
        url: str,
        timeout: float,
        advice: Callable[[], str] | None = None,
        token: str | None = None,
    ) -> None:
        super().__init__(url, timeout, advice)
        self._token = token
        self._lines: deque[_Line] = deque()
        self._numbers = itertools.count(1)
        self._pid = os.getpid()
        self._closed = False

    def close(self) -> None:
        """Drops the connections; a second call does nothing."""
        self._closed = True
        while self._lines:
            self._lines.pop().close()

    def _once(self, call: Call[Any], given_up: threading.Event | None) -> Any:
        number = next(self._numbers)
        message = frames.request(number, call)
        line = self._line()
        try:
            line.send(message)
            head, reply = self._await(line, number, call, given_up)
            result = frames.answer(head, reply, call.binary)
        except Problem:
            self._keep(line)
            raise
        except zmq.ZMQError as error:
            line.close()
            raise Lost(lambda: self._broke(call.op, call.repeatable)) from error
        except ValueError as error:
            line.close()
            raise self._nonsense(call.op, f"something else than this protocol ({error})") from error
        except BaseException:
            # Somebody's Ctrl-C, too: what was asked is not wanted any more.
            line.abandon(number)
            raise
        self._keep(line)
        return result

    def _await(
        self, line: _Line, number: int, call: Call[Any], given_up: threading.Event | None
    ) -> tuple[dict[str, Any], list[Any]]:
        asked = heard = pinged = time.monotonic()
        while True:
            try:
                reply = line.receive()
            except zmq.Again:
                now = time.monotonic()
                if line.broken():
                    raise
                overdue = now > asked + self.timeout + call.slack
                if overdue or now - heard > max(self.timeout, 2 * LOOK) or (given_up and given_up.is_set()):
                    raise self._silent(call.op) from None
                if now - max(pinged, heard) > PING:
                    line.send(frames.control(0, "ping"))
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
        made = _Line(self.url, min(LOOK, self.timeout), self._token)
        if not made.established(min(self.timeout, CONNECT)):
            made.close()
            raise self._nobody()
        return made

    def _keep(self, line: _Line) -> None:
        if self._closed or len(self._lines) >= KEPT:
            line.close()
        else:
            self._lines.append(line)


class _Line:
    """One connection, never renewed. What goes wrong with it is a `zmq.ZMQError`."""

    def __init__(self, url: str, look: float, token: str | None) -> None:
        # The instance notices a fork and makes a context of the child's own.
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, round(1000 * look))
        # No queue for a server that is not there, and no second try behind our back.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self._socket.setsockopt(zmq.RECONNECT_IVL, -1)
        if token is not None:
            # PLAIN: the name says nothing, the password is the token.
            self._socket.setsockopt(zmq.PLAIN_USERNAME, b"iplw")
            self._socket.setsockopt(zmq.PLAIN_PASSWORD, token.encode())
        self._url = url

    def established(self, patience: float) -> bool:
        """Connects; False if that cannot be."""
        # A name of its own: by default it is that of a file number, which closed sockets leave behind for others.
        monitor = self._socket.get_monitor_socket(_BEGINS | _ENDS, f"inproc://iplw.{uuid.uuid4().hex}")
        try:
            self._socket.connect(self._url)
            if not monitor.poll(round(1000 * patience)):
                return False
            # Asking whether it is broken makes the socket take note of it, which sending alone does only now and then.
            return recv_monitor_message(monitor)["event"] == _BEGINS and not self.broken()
        finally:
            self._socket.disable_monitor()
            monitor.close(0)

    def send(self, message: list[Any]) -> None:
        """Sends a message; a connection that does not take it at once has ended."""
        self._socket.send_multipart(message, zmq.NOBLOCK)

    def receive(self) -> list[bytes]:
        """The next message, or after `look` s `zmq.Again`."""
        return self._socket.recv_multipart()

    def broken(self) -> bool:
        """Whether the connection has ended: then there is nowhere to send to."""
        return not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLOUT

    def abandon(self, number: int) -> None:
        """Tells the server that the answer is not waited for, as far as that goes at once."""
        with suppress(zmq.ZMQError):
            self.send(frames.control(0, "cancel", request=number))
        self.close(FAREWELL)

    def close(self, linger: float = 0.0) -> None:
        """Drops the connection."""
        self._socket.close(round(1000 * linger))
