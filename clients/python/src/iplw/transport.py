"""How a client speaks to a server: one interface, chosen by the address.

| address | file | speaks |
|---|---|---|
| `http://`, `https://` | `http` | MessagePack where `msgpack` is installed, with raw arrays for batches; else JSON |
| `tcp://`, `ipc://` | `zeromq` | ZeroMQ with raw arrays; needs `pip install 'iplw[zmq]'` |
"""

from __future__ import annotations

import random
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar
from urllib.parse import urlsplit

from .errors import Problem, ServerUnavailable
from .operations import Call

T = TypeVar("T")
#: Items of a list asked for at a time.
_PAGE = 1000
#: First and longest pause before a busy server is asked again, s.
_PAUSES = (0.005, 0.5)


class Transport(ABC):
    """A way to one server; safe to use from several threads, and by a forked child."""

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout}; allowed: a number of seconds above 0")
        #: The server's address.
        self.url = url
        #: Seconds for each request.
        self.timeout = timeout
        self._advice = advice

    def do(self, call: Call[T]) -> T:
        """Carries one call out.

        A refusal raises `Problem`; no answer `ServerUnavailable`. A server that says it is busy has not begun, so
        it is asked again while the timeout lasts.
        """
        pause = None
        while True:
            try:
                return call.read(self.send(call))
            except Problem as problem:
                pause = pause or Pause(self.timeout)
                wait = pause.after(problem)
                if wait is None:
                    raise
                time.sleep(wait)

    @abstractmethod
    def send(self, call: Call[Any]) -> Any:
        """The answer as it came: lists and dicts, with arrays as NumPy has them where they came raw; or bytes."""

    def items(self, op: str, name: str, args: Mapping[str, Any] | None = None) -> Iterator[Any]:
        """All items of the list `name`, page by page."""
        cursor: str | None = None
        while True:
            answer = self.do(page(op, args or {}, cursor))
            yield from answer[name]
            cursor = answer.get("next")
            if cursor is None:
                return

    def events(self, job: str, last_id: str, patience: float) -> Iterator[Event] | None:
        """A job's events after `last_id`, or None where the transport has none: then look from time to time."""
        return None

    @abstractmethod
    def close(self) -> None:
        """Drops the connections; a second call does nothing."""


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


def connect(url: str, timeout: float, advice: Callable[[], str] | None = None) -> Transport:
    """The transport for an address; without a scheme it is HTTP.

    `advice`: what to tell someone whose request failed; asked only then.
    """
    scheme = scheme_of(url)
    if scheme in ("tcp", "ipc"):
        from .zeromq import ZeroMq

        return ZeroMq(url, timeout, advice)
    from .http import Http

    return Http(url if "://" in url else "http://" + url, timeout, advice)


def scheme_of(url: str) -> str:
    """`http`, `https`, `tcp` or `ipc`; anything else is a `ValueError`."""
    full = url if "://" in url else "http://" + url
    parts = urlsplit(full)
    fine = (
        parts.scheme in ("http", "https", "tcp")
        and parts.hostname
        and (parts.scheme != "tcp" or _has_port(full))
    )
    if not fine and not (parts.scheme == "ipc" and len(full) > len("ipc://")):
        raise ValueError(
            f"url is {url!r}; allowed: an address like http://127.0.0.1:8080, tcp://127.0.0.1:5555 or ipc:///tmp/iplw"
        )
    return parts.scheme


def page(op: str, args: Mapping[str, Any], cursor: str | None) -> Call[Any]:
    """One page of a list."""
    more = {} if cursor is None else {"cursor": cursor}
    return Call(op, {**args, "limit": _PAGE, **more}, lambda answer: answer)


def closed() -> ServerUnavailable:
    """What a closed client raises."""
    return ServerUnavailable("this client is closed; make a new iplw.Client()")


def _has_port(url: str) -> bool:
    try:
        return urlsplit(url).port is not None
    except ValueError:
        return False
