"""HTTP: MessagePack in and out where it is installed, else JSON; refusals as exceptions, repeats only where they do no
harm.
"""

from __future__ import annotations

import json
import math
import os
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import urllib3
from urllib3.connectionpool import HTTPConnectionPool
from urllib3.util import Timeout

from . import codec
from .errors import Problem, ServerUnavailable
from .exchange import Answer, Connection
from .operations import OPERATIONS, Call
from .transport import Event, Transport, closed, scheme_of

_JSON = "application/json"
_PACKED = "application/msgpack"
_ACCEPT_JSON = f"{_JSON}, application/problem+json"
_ACCEPT_RAW = f"{_PACKED}; arrays=raw"
#: What stands in a path as it is.
_SAFE = re.compile(r"[A-Za-z0-9_.~:-]+").fullmatch
#: Connections kept for the next requests.
KEPT = 64
#: Repeats of what may be repeated after a lost connection or a gateway's refusal.
REPEATS = 2


class Http(Transport):
    """Kept connections to one server: our own for requests, urllib3's for TLS and for streams of events."""

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        scheme = scheme_of(url)
        super().__init__(url.rstrip("/"), timeout, advice)
        parts = urlsplit(self.url)
        self._prefix = parts.path.rstrip("/")
        self._where = (str(parts.hostname), parts.port or 80) if scheme == "http" else None
        self._kept: deque[Connection] = deque()
        self._streams: HTTPConnectionPool | None = None
        self._pid = os.getpid()
        self._closed = False

    def send(self, call: Call[Any]) -> Any:
        """The JSON or MessagePack answer (None if empty), or its bytes."""
        address, headers, payload = request(call)
        answer = self._request(call, address, payload, headers)
        data = answer.data
        if call.binary:
            return data
        if not data:
            return None
        try:
            if answer.headers.get("content-type", "").startswith(_PACKED):
                return codec.unpack(data)
            # Decoded here, since json would first look for other encodings.
            return json.loads(data.decode())
        except ValueError as error:
            raise ServerUnavailable(
                f"{self.url} answered {call.op} with something other than JSON ({data[:60]!r}); "
                "is it an iplw server?"
            ) from error

    def events(self, job: str, last_id: str = "", patience: float = math.inf) -> Iterator[Event]:
        """A job's server-sent events until the stream ends; continues after the event `last_id`.

        Silence for `patience` or the timeout, whichever is less, s, raises `ServerUnavailable`.
        """
        headers = {"Accept": "text/event-stream", "Cache-Control": "no-cache"}
        if last_id:
            headers["Last-Event-ID"] = last_id
        slack = min(0.0, max(patience, 0.01) - self.timeout)
        path = f"/v1/jobs/{_quoted(job)}/events"
        try:
            response = self._through_urllib3("GET", path, None, headers, slack, stream=True)
            if response.status >= 300:
                raise _problem(_whole(response))
            try:
                yield from _parse(response.stream(65536))
            finally:
                # The rest of the stream is of no use, so neither is its connection.
                response.close()
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise self._unavailable("GET", path, error) from error

    def close(self) -> None:
        """Drops the connections; a second call does nothing."""
        self._closed = True
        if self._pid == os.getpid():
            while self._kept:
                self._kept.pop().close()
            if self._streams is not None:
                self._streams.close()
        self._streams = None

    def _request(
        self, call: Call[Any], path: str, payload: bytes | None, headers: Mapping[str, str]
    ) -> Answer:
        method, repeats = OPERATIONS[call.op].method, 0
        while True:
            try:
                answer = self._once(method, path, payload, headers, call.slack)
            except (urllib3.exceptions.HTTPError, OSError) as error:
                # Nobody there is nobody there; silence has cost its time already.
                final = isinstance(error, (_Nobody, TimeoutError, urllib3.exceptions.TimeoutError))
                if final or repeats == REPEATS or not call.repeatable:
                    raise self._unavailable(method, path, error) from error
            else:
                if answer.status < 300:
                    return answer
                if answer.status not in (502, 503, 504) or repeats == REPEATS or not call.repeatable:
                    raise _problem(answer)
            repeats += 1
            time.sleep(0.1)

    def _once(
        self, method: str, path: str, payload: bytes | None, headers: Mapping[str, str], slack: float
    ) -> Answer:
        self._mine()
        if self._where is None:
            return _whole(self._through_urllib3(method, path, payload, headers, slack))
        connection = self._connection(self._where)
        try:
            answer = connection.ask(method, self._prefix + path, headers, payload, self.timeout + slack)
        except BaseException:
            connection.close()
            raise
        if answer.keep and len(self._kept) < KEPT and not self._closed:
            self._kept.append(connection)
        else:
            connection.close()
        return answer

    def _connection(self, where: tuple[str, int]) -> Connection:
        while True:
            try:
                kept = self._kept.pop()
            except IndexError:
                break
            if not kept.dropped():
                return kept
            kept.close()
        try:
            return Connection(*where, min(self.timeout, 10.0))
        except OSError as error:
            raise _Nobody(str(error)) from error

    def _through_urllib3(
        self,
        method: str,
        path: str,
        payload: bytes | None,
        headers: Mapping[str, str],
        slack: float,
        stream: bool = False,
    ) -> urllib3.BaseHTTPResponse:
        self._mine()
        if self._streams is None:
            self._streams = urllib3.connection_from_url(self.url, maxsize=KEPT)
        return self._streams.urlopen(
            method,
            self._prefix + path,
            body=payload,
            headers=headers,
            retries=False,
            redirect=False,
            timeout=Timeout(connect=min(self.timeout, 10.0), read=self.timeout + slack),
            preload_content=not stream,
        )

    def _mine(self) -> None:
        if self._closed:
            raise closed()
        if self._pid != os.getpid():
            # A forked child must not talk over its parent's sockets.
            self._kept, self._streams, self._pid = deque(), None, os.getpid()

    def _unavailable(self, method: str, path: str, error: Exception) -> ServerUnavailable:
        advice = self._advice() if self._advice else ""
        if isinstance(error, (TimeoutError, urllib3.exceptions.ReadTimeoutError)):
            what = f"no answer to {method} {path} from {self.url} within {self.timeout:g} s"
            todo = advice or "give it longer with iplw.Client(timeout=...), or ask for less at once"
        elif isinstance(
            error,
            (_Nobody, urllib3.exceptions.NewConnectionError, urllib3.exceptions.ConnectTimeoutError),
        ):
            what = f"no iplw server at {self.url}"
            todo = advice or (
                "start one with `iplw serve`, check the address, or leave `url` out to get a private server"
            )
        else:
            what = f"the connection to {self.url} broke during {method} {path} ({error})"
            todo = (
                advice or "check whether the server still runs; what was asked may or may not have happened"
            )
        return ServerUnavailable(f"{what}; {todo}")


class _Nobody(OSError):
    """No connection could be made."""


def request(call: Call[Any]) -> tuple[str, Mapping[str, str], bytes | None]:
    """The path with its query, the headers and the body of a call."""
    operation = OPERATIONS[call.op]
    rest = dict(call.args)
    address = "".join(
        [part if name is None else _quoted(str(rest.pop(name))) for part, name in _parts(operation.path)]
    )
    # A file that is JSON is to come as such.
    packed = codec.has_msgpack() and not call.binary
    headers = {"Accept": (_ACCEPT_RAW if call.raw else _PACKED) if packed else _ACCEPT_JSON}
    kind, payload = "", None
    if "csv" in rest:
        kind, payload = "text/csv", str(rest.pop("csv")).encode()
    elif isinstance(rest.get("body"), bytes):
        kind, payload = "application/octet-stream", rest.pop("body")
    elif operation.method == "POST" or (operation.method == "DELETE" and rest):
        kind, payload = (_PACKED, codec.pack(rest)) if packed else (_JSON, codec.to_json(rest))
        rest = {}
    if kind:
        headers["Content-Type"] = kind
    if call.key is not None:
        headers["Idempotency-Key"] = call.key
    return address + ("?" + urlencode(rest) if rest else ""), headers, payload


@lru_cache
def _parts(path: str) -> list[tuple[str, str | None]]:
    """`/v1/worlds/{id}/step` as `/v1/worlds/`, `{id}`, `/step`, with the names of what is to be put in."""
    parts = path.replace("{", "\0{").replace("}", "}\0").split("\0")
    return [(part, part[1:-1] if part.startswith("{") else None) for part in parts]


def _quoted(part: str) -> str:
    # Most ids need nothing done, and quote() takes its time.
    return part if _SAFE(part) else quote(part, safe=":")


def _whole(response: urllib3.BaseHTTPResponse) -> Answer:
    data = b""
    with suppress(urllib3.exceptions.HTTPError, OSError):
        data = response.data
    headers = {name.lower(): value for name, value in response.headers.items()}
    return Answer(response.status, headers, data, True, response.reason or "")


def _problem(answer: Answer) -> Problem:
    problem: Any = None
    with suppress(ValueError):
        packed = "msgpack" in answer.headers.get("content-type", "")
        problem = codec.unpack(answer.data) if packed else json.loads(answer.data)
    if isinstance(problem, dict):
        return Problem.from_json(answer.status, problem)
    text = answer.data.decode(errors="replace").strip()[:200]
    return Problem(answer.status, text or "the server gave no reason", title=answer.reason)


def _parse(chunks: Iterator[bytes]) -> Iterator[Event]:
    """Events out of a byte stream, by the rules of the WHATWG specification of server-sent events."""
    name, last_id = "message", ""
    data: list[str] = []
    rest = b""
    for chunk in chunks:
        *lines, rest = (rest + chunk).replace(b"\r\n", b"\n").split(b"\n")
        for line in lines:
            if not line:
                if data:
                    yield Event(name, last_id, "\n".join(data))
                name, data = "message", []
                continue
            field, _, value = line.decode(errors="replace").partition(":")
            value = value.removeprefix(" ")
            if field == "event":
                name = value
            elif field == "data":
                data.append(value)
            elif field == "id":
                last_id = value
