"""HTTP: JSON in and out, MessagePack for arrays, refusals as exceptions, repeats only where they do no harm."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import numpy as np
import urllib3
from urllib3.connectionpool import HTTPConnectionPool
from urllib3.util import Retry, Timeout

from . import codec
from .errors import Problem, ServerUnavailable
from .operations import OPERATIONS, Call
from .transport import Event, Transport, closed, scheme_of

_JSON = "application/json"
_PACKED = "application/msgpack"
_PROBLEM = "application/problem+json"


class Http(Transport):
    """A keep-alive connection pool to one server."""

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        scheme_of(url)
        super().__init__(url.rstrip("/"), timeout, advice)
        self._prefix = urlsplit(self.url).path.rstrip("/")
        self._pool: HTTPConnectionPool | None = None
        self._pid = os.getpid()
        self._closed = False

    def send(self, call: Call[Any]) -> Any:
        """The JSON or MessagePack answer (None if empty), or its bytes."""
        operation = OPERATIONS[call.op]
        address, headers, payload = request(call)
        response = self._request(operation.method, address, payload, headers, call.slack, call.repeatable)
        data = response.data
        if call.binary:
            return data
        if not data:
            return None
        try:
            if response.headers.get("Content-Type", "").startswith(_PACKED):
                return codec.unpack(data)
            return json.loads(data)
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
        response = self._request("GET", path, None, headers, slack, False, stream=True)
        try:
            yield from _parse(response.stream(65536))
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise self._unavailable("GET", path, error) from error
        finally:
            # The rest of the stream is of no use, so neither is its connection.
            response.close()

    def close(self) -> None:
        """Drops the connections; a second call does nothing."""
        self._closed = True
        if self._pool is not None and self._pid == os.getpid():
            self._pool.close()
        self._pool = None

    def _request(
        self,
        method: str,
        path: str,
        payload: bytes | None,
        headers: Mapping[str, str],
        slack: float,
        repeat: bool,
        stream: bool = False,
    ) -> urllib3.BaseHTTPResponse:
        try:
            response = self._connections().urlopen(
                method,
                self._prefix + path,
                body=payload,
                headers=headers,
                retries=_retries() if repeat else False,
                redirect=False,
                timeout=Timeout(connect=min(self.timeout, 10.0), read=self.timeout + slack),
                preload_content=not stream,
            )
        except (urllib3.exceptions.HTTPError, OSError) as error:
            raise self._unavailable(method, path, error) from error
        if response.status >= 300:
            raise _problem(response)
        return response

    def _connections(self) -> HTTPConnectionPool:
        if self._closed:
            raise closed()
        if self._pool is None or self._pid != os.getpid():
            # A forked child must not talk over its parent's sockets.
            self._pool = urllib3.connection_from_url(self.url, maxsize=64)
            self._pid = os.getpid()
        return self._pool

    def _unavailable(self, method: str, path: str, error: Exception) -> ServerUnavailable:
        advice = self._advice() if self._advice else ""
        cause: BaseException = error
        while isinstance(cause, urllib3.exceptions.MaxRetryError) and cause.reason is not None:
            cause = cause.reason
        if isinstance(cause, urllib3.exceptions.ReadTimeoutError):
            what = f"no answer to {method} {path} from {self.url} within {self.timeout:g} s"
            todo = advice or "give it longer with iplw.Client(timeout=...), or ask for less at once"
        elif isinstance(
            cause, (urllib3.exceptions.NewConnectionError, urllib3.exceptions.ConnectTimeoutError)
        ):
            what = f"no iplw server at {self.url}"
            todo = advice or (
                "start one with `iplw serve`, check the address, or leave `url` out to get a private server"
            )
        else:
            what = f"the connection to {self.url} broke during {method} {path} ({cause})"
            todo = (
                advice or "check whether the server still runs; what was asked may or may not have happened"
            )
        return ServerUnavailable(f"{what}; {todo}")


def request(call: Call[Any]) -> tuple[str, dict[str, str], bytes | None]:
    """The path with its query, the headers and the body of a call."""
    operation = OPERATIONS[call.op]
    rest = dict(call.args)
    address = "".join(
        _quoted(str(rest.pop(part[1:-1]))) if part.startswith("{") else part
        for part in _parts(operation.path)
    )
    packed = codec.has_msgpack() and (
        call.raw or any(isinstance(value, np.ndarray) for value in rest.values())
    )
    headers = {"Accept": f"{_PACKED}; arrays=raw" if packed else f"{_JSON}, {_PROBLEM}"}
    if call.key is not None:
        headers["Idempotency-Key"] = call.key
    payload: bytes | None = None
    if "csv" in rest:
        headers["Content-Type"] = "text/csv"
        payload = str(rest.pop("csv")).encode()
    elif isinstance(rest.get("body"), bytes):
        headers["Content-Type"] = "application/octet-stream"
        payload = rest.pop("body")
    elif operation.method == "POST" or (operation.method == "DELETE" and rest):
        headers["Content-Type"] = _PACKED if packed else _JSON
        payload = codec.pack(rest) if packed else codec.to_json(rest)
        rest = {}
    return address + ("?" + urlencode(rest) if rest else ""), headers, payload


def _parts(path: str) -> list[str]:
    """`/v1/worlds/{id}/step` as `/v1/worlds/`, `{id}`, `/step`."""
    known = _PARTS.get(path)
    if known is None:
        known = _PARTS[path] = path.replace("{", "\0{").replace("}", "}\0").split("\0")
    return known


_PARTS: dict[str, list[str]] = {}


def _quoted(part: str) -> str:
    return quote(part, safe=":")


def _retries() -> Retry:
    return Retry(
        total=2,
        redirect=0,
        backoff_factor=0.1,
        allowed_methods=None,
        status_forcelist=(502, 503, 504),
        raise_on_status=False,
    )


def _problem(response: urllib3.BaseHTTPResponse) -> Problem:
    body = b""
    with suppress(urllib3.exceptions.HTTPError, OSError):
        body = response.data
    problem: Any = None
    with suppress(ValueError):
        packed = "msgpack" in response.headers.get("Content-Type", "")
        problem = codec.unpack(body) if packed else json.loads(body)
    if isinstance(problem, dict):
        return Problem.from_json(response.status, problem)
    text = body.decode(errors="replace").strip()[:200]
    return Problem(response.status, text or "the server gave no reason", title=response.reason or "")


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
