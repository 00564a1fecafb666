"""Interface of the transports; `connect` chooses one by the address.

| address | module | protocol |
|---|---|---|
| `http://`, `https://` | `http` | HTTP; MessagePack with raw arrays if `msgpack` is installed, else JSON |
| `tcp://`, `ipc://` | `zeromq` | ZeroMQ with raw arrays; requires `pip install 'iplw[zmq]'` |
"""

from __future__ import annotations

import random
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

from .request import Request
from .errors import IplwError, Problem, ServerUnavailable

#: Maximum time to connect, s; the timeout applies if it is shorter.
CONNECT_TIMEOUT_S = 10.0
#: Idle connections kept for reuse.
MAX_IDLE_CONNECTIONS = 64
#: Retries of an idempotent request after a lost connection or a gateway error, and the delay before each, s.
MAX_RETRIES, RETRY_DELAY_S = 2, 0.1
#: First and longest delay before a request to a busy server is retried, s.
_BACKOFF_RANGE_S = (0.005, 0.5)


class Transport(ABC):
    """Sends requests to one server; thread-safe and fork-safe."""

    #: Command that starts a server for this transport, and the server's description, for messages.
    _start_command: str
    _server_description: str

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout}; allowed: a number of seconds above 0")
        #: The server's address.
        self.url = url
        #: Timeout of each request, s.
        self.timeout = timeout
        self._advice = advice

    def send(self, call: Request[Any], cancelled: threading.Event | None = None) -> Any:
        """Sends a request and returns the raw response: lists and dicts, with NumPy arrays if sent raw; or bytes.

        Raises `Problem` if the server rejects it and `ServerUnavailable` if there is no response. Another thread may set
        `cancelled`; ZeroMQ then notifies the server and the call ends.
        """
        retries_left = MAX_RETRIES if call.can_retry else 0
        while True:
            try:
                return self._send_once(call, cancelled)
            except RetryableError as lost:
                if retries_left == 0:
                    raise lost.make_error() from lost.__cause__
            retries_left -= 1
            time.sleep(RETRY_DELAY_S)

    def events(self, job: str, last_id: str, max_silence: float) -> Stream | None:
        """A job's events after `last_id`; None if the transport has no events, then poll.

        Raises `ServerUnavailable` after a silence of `max_silence` or the timeout, whichever is less, s.
        """
        return None

    @abstractmethod
    def close(self) -> None:
        """Closes the connections; idempotent."""

    @abstractmethod
    def _send_once(self, call: Request[Any], cancelled: threading.Event | None) -> Any:
        """`send` without retries: raises `RetryableError` if a retry may succeed."""

    def _unreachable(self) -> ServerUnavailable:
        action = f"start one with `{self._start_command}`, check the address, or leave `url` out to get a private server"
        return ServerUnavailable(f"no iplw server at {self.url}; {self._with_advice(action)}")

    def _connection_lost(self, what: str, can_retry: bool, why: str = "") -> ServerUnavailable:
        warning = "" if can_retry else "; the request may or may not have been executed"
        action = self._with_advice(f"check whether the server still runs{warning}")
        return ServerUnavailable(f"the connection to {self.url} broke during {what}{why and f' ({why})'}; {action}")

    def _timed_out(self, what: str) -> ServerUnavailable:
        action = self._with_advice("increase iplw.Client(timeout=...), or request less at once")
        return ServerUnavailable(f"no answer to {what} from {self.url} within {self.timeout:g} s; {action}")

    def _invalid_response(self, what: str, why: str) -> ServerUnavailable:
        return ServerUnavailable(f"{self.url} responded to {what} with {why}; is it {self._server_description}?")

    def _with_advice(self, action: str) -> str:
        return (self._advice() if self._advice else "") or action


class RetryableError(Exception):
    """The connection was lost, or a gateway failed: a retry may succeed. `make_error` creates the final error."""

    def __init__(self, make_error: Callable[[], IplwError]) -> None:
        super().__init__()
        self.make_error = make_error


class Event:
    """One event of a stream."""

    __slots__ = ("data", "id", "name")

    def __init__(self, name: str, id: str, data: str) -> None:
        self.name = name
        self.id = id
        self.data = data

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Event):
            return NotImplemented
        return (self.name, self.id, self.data) == (other.name, other.id, other.data)

    def __hash__(self) -> int:
        return hash((self.name, self.id, self.data))


class Stream(Iterator[Event]):
    """Iterator over events."""

    @abstractmethod
    def stop(self) -> None:
        """Stops the stream, even while another thread waits for the next event."""


class Backoff:
    """Exponential backoff with jitter for a busy server, until the timeout."""

    def __init__(self, timeout: float) -> None:
        self._until = time.monotonic() + timeout
        self._next = _BACKOFF_RANGE_S[0]

    def delay(self, problem: Problem) -> float | None:
        """Delay before the next attempt, s; None if the problem is not `busy` or the timeout has passed."""
        if problem.slug != "busy" or time.monotonic() > self._until:
            return None
        # Jitter: rejected clients must not retry simultaneously.
        wait = self._next * random.uniform(0.5, 1.0)
        self._next = min(2 * self._next, _BACKOFF_RANGE_S[1])
        return wait


def closed_error() -> ServerUnavailable:
    """The error of a closed client."""
    return ServerUnavailable("this client is closed; make a new iplw.Client()")
