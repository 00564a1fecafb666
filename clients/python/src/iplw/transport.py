"""How a client speaks to a server: one interface; `connect` chooses by the address.

| address | file | speaks |
|---|---|---|
| `http://`, `https://` | `http` | MessagePack where `msgpack` is installed, with raw arrays for batches; else JSON |
| `tcp://`, `ipc://` | `zeromq` | ZeroMQ with raw arrays; needs `pip install 'iplw[zmq]'` |
"""

from __future__ import annotations

import random
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

from .call import Call
from .errors import IplwError, Problem, ServerUnavailable

#: Longest time that making a connection may take, s, if the timeout is not shorter.
CONNECT = 10.0
#: Connections kept for the next requests.
KEPT = 64
#: Repeats of what may be repeated after a lost connection or a gateway's refusal, and the pause before each, s.
REPEATS, REPEAT_AFTER = 2, 0.1
#: First and longest pause before a busy server is asked again, s.
_PAUSES = (0.005, 0.5)


class Transport(ABC):
    """A way to one server; safe to use from several threads, and by a forked child."""

    #: What starts a server that this transport reaches, and what it should reach.
    _start: str
    _what: str

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout}; allowed: a number of seconds above 0")
        #: The server's address.
        self.url = url
        #: Seconds for each request.
        self.timeout = timeout
        self._advice = advice

    def send(self, call: Call[Any], given_up: threading.Event | None = None) -> Any:
        """The answer as it came: lists and dicts, with arrays as NumPy has them where they came raw; or bytes.

        A refusal raises `Problem`; no answer `ServerUnavailable`. Another thread may set `given_up` when it does not
        want the answer any more; where the transport can, the server is told and the call ends.
        """
        repeats = REPEATS if call.repeatable else 0
        while True:
            try:
                return self._once(call, given_up)
            except Lost as lost:
                if repeats == 0:
                    raise lost.told() from lost.__cause__
            repeats -= 1
            time.sleep(REPEAT_AFTER)

    def events(self, job: str, last_id: str, patience: float) -> Stream | None:
        """A job's events after `last_id`, or None where the transport has none: then look from time to time.

        Silence for `patience` or the timeout, whichever is less, s, raises `ServerUnavailable`.
        """
        return None

    @abstractmethod
    def close(self) -> None:
        """Drops the connections; a second call does nothing."""

    @abstractmethod
    def _once(self, call: Call[Any], given_up: threading.Event | None) -> Any:
        """`send` without repeats: what may be repeated raises `Lost`."""

    def _nobody(self) -> ServerUnavailable:
        todo = f"start one with `{self._start}`, check the address, or leave `url` out to get a private server"
        return ServerUnavailable(f"no iplw server at {self.url}; {self._advised(todo)}")

    def _broke(self, what: str, repeatable: bool, why: str = "") -> ServerUnavailable:
        doubt = "" if repeatable else "; what was asked may or may not have happened"
        todo = self._advised(f"check whether the server still runs{doubt}")
        return ServerUnavailable(f"the connection to {self.url} broke during {what}{why and f' ({why})'}; {todo}")

    def _silent(self, what: str) -> ServerUnavailable:
        todo = self._advised("give it longer with iplw.Client(timeout=...), or ask for less at once")
        return ServerUnavailable(f"no answer to {what} from {self.url} within {self.timeout:g} s; {todo}")

    def _nonsense(self, what: str, why: str) -> ServerUnavailable:
        return ServerUnavailable(f"{self.url} answered {what} with {why}; is it {self._what}?")

    def _advised(self, todo: str) -> str:
        return (self._advice() if self._advice else "") or todo


class Lost(Exception):
    """The connection was lost, or a gateway refused: trying again may help. `told` makes what to raise if not."""

    def __init__(self, told: Callable[[], IplwError]) -> None:
        super().__init__()
        self.told = told


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
    """Events as they come."""

    @abstractmethod
    def stop(self) -> None:
        """Ends it, also for another thread that waits for the next event."""


class Pause:
    """When to ask a busy server again: soon, then less and less often, until the time is up."""

    def __init__(self, timeout: float) -> None:
        self._until = time.monotonic() + timeout
        self._next = _PAUSES[0]

    def after(self, problem: Problem) -> float | None:
        """Seconds to wait, or None if the problem is not of the kind that passes or the time is up."""
        if problem.slug != "busy" or time.monotonic() > self._until:
            return None
        # Clients that were refused together should not come back together.
        wait = self._next * random.uniform(0.5, 1.0)
        self._next = min(2 * self._next, _PAUSES[1])
        return wait


def closed() -> ServerUnavailable:
    """What a closed client raises."""
    return ServerUnavailable("this client is closed; make a new iplw.Client()")
