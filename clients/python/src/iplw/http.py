"""Requests to one server: JSON in and out, refusals as exceptions, repeats only where they do no harm."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import urllib3
from urllib3.connectionpool import HTTPConnectionPool
from urllib3.util import Retry, Timeout

from .errors import Problem, ServerUnavailable

#: GET and DELETE may be sent again after a lost connection; a repeated POST could act twice.
_REPEATABLE = frozenset({"GET", "DELETE"})
#: Items asked for at a time.
_PAGE = 1000
_JSON = {"Accept": "application/json, application/problem+json"}


@dataclass(frozen=True)
class Event:
    """One server-sent event."""

    name: str
    id: str
    data: str


class Http:
    """A keep-alive connection pool to the server at `url`; safe to use from several threads."""

    def __init__(self, url: str, timeout: float, advice: Callable[[], str] | None = None) -> None:
        self.url = _checked(url)
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout}; allowed: a number of seconds above 0")
        self.timeout = timeout
        self._advice = advice
        self._prefix = urlsplit(self.url).path.rstrip("/")
        self._pool: HTTPConnectionPool | None = None
        self._pid = os.getpid()
        self._closed = False

    def call(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | None = None,
        *,
        slack: float = 0.0,
        repeat: bool = True,
        key: str | None = None,
    ) -> Any:
        """The JSON answer (None if empty).

        `slack`: seconds granted beyond the timeout for heavy requests. `key`: what makes the request one that
        the server carries out once, however often it arrives; it is then repeated after a lost connection.
        """
        return self.json(method, path, body, slack=slack, repeat=repeat, key=key)

    def json(self, method: str, path: str, body: Mapping[str, Any] | bytes | None, **how: Any) -> Any:
        """[`raw`], read as JSON."""
        data = self.raw(method, path, body, **how)
        if not data:
            return None
        try:
            return json.loads(data)
        except ValueError as error:
            raise ServerUnavailable(
                f"{self.url} answered {method} {path} with something other than JSON ({data[:60]!r}); "
                "is it an iplw server?"
            ) from error

    def raw(
        self,
        method: str,
        path: str,
        body: Mapping[str, Any] | bytes | None = None,
        *,
        slack: float = 0.0,
        repeat: bool = True,
        key: str | None = None,
        kind: str = "application/octet-stream",
    ) -> bytes:
        """The answer's body as it came. A body of bytes is sent as they are, as of that kind."""
        headers = dict(_JSON)
        if key is not None:
            headers["Idempotency-Key"] = key
        payload: bytes | None = None
        if isinstance(body, bytes):
            headers["Content-Type"] = kind
            payload = body
        elif body is not None:
            headers["Content-Type"] = "application/json"
            payload = json.dumps(body, allow_nan=False).encode()
        response = self._send(method, path, payload, headers, slack, repeat, stream=False)
        return response.data

    def items(self, path: str, name: str) -> Iterator[Any]:
        """All items of the list `name` at `path`, page by page."""
        cursor: str | None = None
        while True:
            page = self.call("GET", path + query(limit=_PAGE, cursor=cursor))
            yield from page[name]
            cursor = page.get("next")
            if cursor is None:
                return

    def events(self, path: str, last_id: str = "", patience: float = math.inf) -> Iterator[Event]:
        """Server-sent events from `path` until the stream ends; continues after the event `last_id`.

        Silence for `patience` or the timeout, whichever is less, s, raises `ServerUnavailable`.
        """
        headers = {"Accept": "text/event-stream", "Cache-Control": "no-cache"}
        if last_id:
            headers["Last-Event-ID"] = last_id
        slack = min(0.0, max(patience, 0.01) - self.timeout)
        response = self._send("GET", path, None, headers, slack, False, stream=True)
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

    def _send(
        self,
        method: str,
        path: str,
        payload: bytes | None,
        headers: Mapping[str, str],
        slack: float,
        repeat: bool,
        stream: bool,
    ) -> urllib3.BaseHTTPResponse:
        retries: Retry | bool = False
        if repeat and (method in _REPEATABLE or "Idempotency-Key" in headers):
            retries = Retry(
                total=2,
                redirect=0,
                backoff_factor=0.1,
                allowed_methods=None,
                status_forcelist=(502, 503, 504),
                raise_on_status=False,
            )
        try:
            response = self._connections().urlopen(
                method,
                self._prefix + path,
                body=payload,
                headers=headers,
                retries=retries,
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
            raise ServerUnavailable("this client is closed; make a new iplw.Client()")
        if self._pool is None or self._pid != os.getpid():
            # A forked child must not talk over its parent's sockets.
            self._pool = urllib3.connection_from_url(self.url, maxsize=8)
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


def path(*parts: str) -> str:
    """`/v1/` and the parts, each quoted."""
    return "/v1/" + "/".join(quote(part, safe=":") for part in parts)


def given(**values: Any) -> dict[str, Any]:
    """The arguments that are not None: what a request says, the rest being the server's default."""
    return {key: value for key, value in values.items() if value is not None}


def query(**values: Any) -> str:
    """`?a=1&b=2` of what is not None, or nothing."""
    said = given(**values)
    return "?" + urlencode(said) if said else ""


def _checked(url: str) -> str:
    if "://" not in url:
        url = "http://" + url
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise ValueError(f"url is {url!r}; allowed: an address like http://127.0.0.1:8080")
    return url.rstrip("/")


def _problem(response: urllib3.BaseHTTPResponse) -> Problem:
    body = b""
    with suppress(urllib3.exceptions.HTTPError, OSError):
        body = response.data
    try:
        problem = json.loads(body)
    except ValueError:
        problem = None
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
