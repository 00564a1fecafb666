"""ZeroMQ by pyzmq: one DEALER socket for each concurrent request, with raw arrays. Fastest for single steps.

A socket connects once. After its connection breaks it is discarded and the next request creates a new one, so a request
to a server that died is never delivered to its successor. While a request is pending, the server is pinged: it may work
until the request's timeout, but may not be silent for longer than the client's timeout.
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

from .request import Request
from .errors import Problem
from .transport import CONNECT_TIMEOUT_S, MAX_IDLE_CONNECTIONS, RetryableError, Transport, closed_error

try:
    import zmq
    from zmq.utils.monitor import recv_monitor_message

    from . import frames
except ImportError as error:
    raise ImportError(
        "tcp:// and ipc:// addresses require pyzmq and msgpack: pip install 'iplw[zmq]'; or use an http:// address"
    ) from error

#: Interval between checks of deadline, connection and cancellation, s.
POLL_S = 0.1
#: Silence after which the server is pinged, s.
PING_AFTER_S = 5.0
#: Linger of a closing socket that sends a cancellation, s.
CANCEL_LINGER_S = 0.1
_CONNECTED_EVENTS = zmq.EVENT_HANDSHAKE_SUCCEEDED
_DISCONNECTED_EVENTS = (
    zmq.EVENT_DISCONNECTED
    | zmq.EVENT_CLOSED
    | zmq.EVENT_CONNECT_RETRIED
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
)


class ZeroMq(Transport):
    """Pooled sockets to one server, each used by one thread at a time."""

    _start_command = "iplw serve --zmq ADDRESS"
    _server_description = "the ZeroMQ address of an iplw server"

    def __init__(
        self,
        url: str,
        timeout: float,
        advice: Callable[[], str] | None = None,
        token: str | None = None,
    ) -> None:
        super().__init__(url, timeout, advice)
        self._token = token
        self._idle_sockets: deque[_DealerSocket] = deque()
        self._numbers = itertools.count(1)
        self._pid = os.getpid()
        self._closed = False

    def close(self) -> None:
        """Closes the sockets; idempotent."""
        self._closed = True
        while self._idle_sockets:
            self._idle_sockets.pop().close()

    def _send_once(self, request: Request[Any], cancelled: threading.Event | None) -> Any:
        number = next(self._numbers)
        message = frames.encode_request(number, request)
        socket = self._acquire()
        try:
            socket.send(message)
            head, reply = self._receive_reply(socket, number, request, cancelled)
            result = frames.decode_reply(head, reply, request.returns_bytes)
        except Problem:
            self._release(socket)
            raise
        except zmq.ZMQError as error:
            socket.close()
            raise RetryableError(lambda: self._connection_lost(request.operation_id, request.can_retry)) from error
        except ValueError as error:
            socket.close()
            raise self._invalid_response(request.operation_id, f"a message that is not of this protocol ({error})") from error
        except BaseException:
            # For example KeyboardInterrupt: cancel the request on the server.
            socket.cancel(number)
            raise
        self._release(socket)
        return result

    def _receive_reply(
        self, socket: _DealerSocket, number: int, request: Request[Any], cancelled: threading.Event | None
    ) -> tuple[dict[str, Any], list[Any]]:
        sent_at = received_at = pinged_at = time.monotonic()
        while True:
            try:
                reply = socket.receive()
            except zmq.Again:
                now = time.monotonic()
                if socket.is_broken():
                    raise
                overdue = now > sent_at + self.timeout + request.extra_timeout_s
                if overdue or now - received_at > max(self.timeout, 2 * POLL_S) or (cancelled and cancelled.is_set()):
                    raise self._timed_out(request.operation_id) from None
                if now - max(pinged_at, received_at) > PING_AFTER_S:
                    socket.send(frames.encode_control(0, "ping"))
                    pinged_at = now
                continue
            head = frames.decode_header(reply)
            # An error without an id means that the message could not be parsed: it belongs to the only pending request.
            if head.get("id") in (number, None):
                return head, reply
            received_at = time.monotonic()

    def _acquire(self) -> _DealerSocket:
        if self._closed:
            raise closed_error()
        if self._pid != os.getpid():
            # A forked child must not use its parent's sockets.
            self._idle_sockets, self._pid = deque(), os.getpid()
        while True:
            try:
                socket = self._idle_sockets.pop()
            except IndexError:
                break
            if not socket.is_broken():
                return socket
            socket.close()
        socket = _DealerSocket(self.url, min(POLL_S, self.timeout), self._token)
        if not socket.connect(min(self.timeout, CONNECT_TIMEOUT_S)):
            socket.close()
            raise self._unreachable()
        return socket

    def _release(self, socket: _DealerSocket) -> None:
        if self._closed or len(self._idle_sockets) >= MAX_IDLE_CONNECTIONS:
            socket.close()
        else:
            self._idle_sockets.append(socket)


class _DealerSocket:
    """One connection, never reconnected. Failures raise `zmq.ZMQError`."""

    def __init__(self, url: str, poll_s: float, token: str | None) -> None:
        # After a fork, `instance` creates a new context.
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, round(1000 * poll_s))
        # No queueing before the connection is established, and no reconnection.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self._socket.setsockopt(zmq.RECONNECT_IVL, -1)
        if token is not None:
            # PLAIN: the password is the token; the user name is ignored.
            self._socket.setsockopt(zmq.PLAIN_USERNAME, b"iplw")
            self._socket.setsockopt(zmq.PLAIN_PASSWORD, token.encode())
        self._url = url

    def connect(self, max_silence: float) -> bool:
        """Connects; returns whether it succeeded."""
        # A unique name: the default is derived from a file descriptor, which closed sockets leave behind.
        monitor = self._socket.get_monitor_socket(_CONNECTED_EVENTS | _DISCONNECTED_EVENTS, f"inproc://iplw.{uuid.uuid4().hex}")
        try:
            self._socket.connect(self._url)
            if not monitor.poll(round(1000 * max_silence)):
                return False
            # Reading the socket's state makes it process its events; sending alone does that only now and then.
            return recv_monitor_message(monitor)["event"] == _CONNECTED_EVENTS and not self.is_broken()
        finally:
            self._socket.disable_monitor()
            monitor.close(0)

    def send(self, message: list[Any]) -> None:
        """Sends a message without blocking; fails if the connection has ended."""
        self._socket.send_multipart(message, zmq.NOBLOCK)

    def receive(self) -> list[bytes]:
        """The next message; `zmq.Again` after `poll_s`."""
        return self._socket.recv_multipart()

    def is_broken(self) -> bool:
        """Whether the connection has ended."""
        return not int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLOUT

    def cancel(self, number: int) -> None:
        """Cancels a request on the server, without waiting, and closes the socket."""
        with suppress(zmq.ZMQError):
            self.send(frames.encode_control(0, "cancel", request=number))
        self.close(CANCEL_LINGER_S)

    def close(self, linger: float = 0.0) -> None:
        """Closes the socket."""
        self._socket.close(round(1000 * linger))
