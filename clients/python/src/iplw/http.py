"""HTTP by urllib3. Bodies are MessagePack if it is installed, else JSON.

Connections are pooled. `https://` uses the system's certificates. A proxy is taken from the environment (`HTTP_PROXY`,
`HTTPS_PROXY`, `NO_PROXY`), but never used for a server on this machine.
"""

from __future__ import annotations

import json
import os
import re
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any
from urllib.parse import quote, urlencode, urlsplit
from urllib.request import getproxies, proxy_bypass

import urllib3
from urllib3.connection import HTTPConnection
from urllib3.exceptions import ConnectTimeoutError, HTTPError, NewConnectionError, ReadTimeoutError
from urllib3.util import Retry, Timeout

from . import codec
from .request import Request
from .errors import Problem, ServerUnavailable
from .operations import OPERATIONS
from .transport import CONNECT_TIMEOUT_S, MAX_IDLE_CONNECTIONS, Event, RetryableError, Stream, Transport, closed_error

_JSON = "application/json"
_PACKED = "application/msgpack"
_CSV = "text/csv"
_BYTES = "application/octet-stream"
_ACCEPT_JSON = f"{_JSON}, application/problem+json"
_ACCEPT_RAW = f"{_PACKED}; arrays=raw"
#: `Transport.send` retries, not urllib3. Created once: urllib3 would create one for each request.
_NO_RETRY = Retry(False, redirect=False)
#: Errors of a gateway: the server may not have received the request.
_GATEWAY = (502, 503, 504)
#: Path segments that need no percent-encoding.
_SAFE = re.compile(r"[A-Za-z0-9_.~:-]+").fullmatch


class Http(Transport):
    """Pooled HTTP connections to one server."""

    _start_command = "iplw serve"
    _server_description = "an iplw server"

    def __init__(
        self,
        url: str,
        timeout: float,
        advice: Callable[[], str] | None = None,
        token: str | None = None,
        verify: bool | str = True,
    ) -> None:
        super().__init__(url.rstrip("/"), timeout, advice)
        self._auth_headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._verify = verify
        self._pool: _Pool | None = None
        self._pid = os.getpid()
        self._closed = False

    def events(self, job: str, last_id: str, max_silence: float) -> Stream:
        """Server-sent events."""
        headers = {"Accept": "text/event-stream", "Cache-Control": "no-cache"}
        if last_id:
            headers["Last-Event-ID"] = last_id
        extra_timeout_s = min(0.0, max(max_silence, 0.01) - self.timeout)
        path = f"/v1/jobs/{_percent_encode(job)}/events"
        return _Events(
            lambda: self._open("GET", path, None, headers, extra_timeout_s, stream=True),
            lambda error: self._unavailable(f"GET {path}", True, error),
        )

    def close(self) -> None:
        """Closes the connections; idempotent."""
        self._closed = True
        pool, self._pool = self._pool, None
        if pool is not None and self._pid == os.getpid():
            pool.close()

    def _send_once(self, request: Request[Any], cancelled: threading.Event | None) -> Any:
        operation = OPERATIONS[request.operation_id]
        path, headers, payload = encode_request(request)
        what = f"{operation.method} {path}"
        try:
            response = self._open(operation.method, path, payload, headers, request.extra_timeout_s)
        except (HTTPError, OSError) as error:
            lost = error
            # No retry: the server is unreachable, or the timeout is used up.
            if _is_unreachable(error) or _is_timeout(error):
                raise self._unavailable(what, request.can_retry, error) from error
            raise RetryableError(lambda: self._unavailable(what, request.can_retry, lost)) from error
        data = response.data
        if response.status >= 300:
            problem = read_problem(response)
            # A retry of a request that exceeded its deadline would exceed it again.
            passes = response.status in _GATEWAY and problem.slug != "deadline"
            raise RetryableError(lambda: problem) if passes else problem
        if not data:
            # urllib3 accepts a response whose headers are truncated, with an empty body.
            if operation.response_types and response.status != 204:
                raise RetryableError(lambda: self._connection_lost(what, request.can_retry, "an empty response"))
            return None
        if request.returns_bytes:
            return data
        try:
            if response.headers.get("content-type", "").startswith(_PACKED):
                return codec.unpack(data)
            # Decoded is_local, since json would first look for other encodings.
            return json.loads(data.decode())
        except ValueError as error:
            raise self._invalid_response(request.operation_id, f"something other than JSON ({data[:60]!r})") from error

    def _open(
        self,
        method: str,
        path: str,
        payload: bytes | None,
        headers: Mapping[str, str],
        extra_timeout_s: float,
        stream: bool = False,
    ) -> urllib3.BaseHTTPResponse:
        pool = self._pool
        if pool is None or self._pid != os.getpid():
            if self._closed:
                raise closed_error()
            # A forked child must not use its parent's sockets.
            pool, self._pid = _Pool(self.url, self._verify), os.getpid()
            self._pool = pool
        return pool.open(
            method,
            pool.base + path,
            body=payload,
            headers={**headers, **self._auth_headers},
            retries=_NO_RETRY,
            redirect=False,
            timeout=Timeout(connect=min(self.timeout, CONNECT_TIMEOUT_S), read=self.timeout + extra_timeout_s),
            preload_content=not stream,
        )

    def _unavailable(self, what: str, can_retry: bool, error: Exception) -> ServerUnavailable:
        if _is_timeout(error):
            return self._timed_out(what)
        return self._unreachable() if _is_unreachable(error) else self._connection_lost(what, can_retry, str(error))


class _Pool:
    """urllib3's connection pool for one server, direct or through a proxy."""

    def __init__(self, url: str, verify: bool | str) -> None:
        parts = urlsplit(url)
        tls_options: dict[str, Any] = {}
        if parts.scheme == "https" and verify is not True:
            tls_options = {"ca_certs": verify} if isinstance(verify, str) else {"cert_reqs": "CERT_NONE"}
        host = str(parts.hostname)
        is_local = host in ("localhost", "::1") or host.startswith("127.")
        proxy = None if is_local or proxy_bypass(host) else getproxies().get(parts.scheme)
        self.open: Callable[..., urllib3.BaseHTTPResponse]
        if proxy:
            manager = urllib3.ProxyManager(proxy, maxsize=MAX_IDLE_CONNECTIONS, **tls_options)
            #: Prefix of each path.
            self.base = url
            self.open, self.close = manager.urlopen, manager.clear
        else:
            pool = urllib3.connection_from_url(url, maxsize=MAX_IDLE_CONNECTIONS, **tls_options)
            if parts.scheme == "http":
                pool.ConnectionCls = _SinglePacketConnection
            self.base = parts.path.rstrip("/")
            self.open, self.close = pool.urlopen, pool.close


class _SinglePacketConnection(HTTPConnection):
    """Sends headers and body in one packet; urllib3 sends two, which wakes the server twice."""

    _unsent_parts: list[bytes] | None = None

    def encode_request(self, *args: Any, **settings: Any) -> None:
        self._unsent_parts = []
        try:
            super().request(*args, **settings)
        finally:
            data, self._unsent_parts = b"".join(self._unsent_parts), None
        self.send(data)

    def send(self, data: Any) -> None:
        if self._unsent_parts is None:
            super().send(data)
        else:
            self._unsent_parts.append(data)


class _Events(Stream):
    """The events of a streaming response."""

    def __init__(
        self,
        ask: Callable[[], urllib3.BaseHTTPResponse],
        unavailable: Callable[[Exception], ServerUnavailable],
    ) -> None:
        self._open = ask
        self._unavailable = unavailable
        self._response: urllib3.BaseHTTPResponse | None = None
        self._stopped = False
        self._events = self._read()

    def __next__(self) -> Event:
        return next(self._events)

    def stop(self) -> None:
        self._stopped = True
        if self._response is not None:
            # The stream may have ended already.
            with suppress(RuntimeError, ValueError, OSError):
                self._response.shutdown()
        # A generator that is running in another thread cannot be closed here; that thread closes it.
        with suppress(ValueError):
            self._events.close()

    def _read(self) -> Generator[Event]:
        try:
            self._response = response = self._open()
            try:
                if response.status >= 300:
                    raise read_problem(response)
                if not self._stopped:
                    yield from parse_events(response.stream(65536))
            finally:
                # The connection cannot be reused before the stream has ended.
                response.close()
        except (HTTPError, OSError) as error:
            raise self._unavailable(error) from error


def encode_request(request: Request[Any]) -> tuple[str, Mapping[str, str], bytes | None]:
    """URL path with query, headers and body of a request."""
    operation = OPERATIONS[request.operation_id]
    rest = dict(request.args)
    address = "".join(
        [part if name is None else _percent_encode(str(rest.pop(name))) for part, name in _split_path(operation.path)]
    )
    # A file in JSON must not be converted to MessagePack.
    packed = codec.has_msgpack() and not request.returns_bytes
    headers = {"Accept": (_ACCEPT_RAW if request.raw_arrays else _PACKED) if packed else _ACCEPT_JSON}
    kind, payload = "", None
    if "csv" in rest:
        kind, payload = _CSV, str(rest.pop("csv")).encode()
    elif _BYTES in operation.request_types:
        kind, payload = _BYTES, rest.pop("body")
    elif operation.request_types:
        kind, payload = (_PACKED, codec.pack(rest)) if packed else (_JSON, codec.to_json(rest))
        rest = {}
    if kind:
        headers["Content-Type"] = kind
    if request.key is not None:
        headers["Idempotency-Key"] = request.key
    return address + ("?" + urlencode(rest) if rest else ""), headers, payload


def read_problem(response: urllib3.BaseHTTPResponse) -> Problem:
    """Parses an error response."""
    body: Any = None
    data = b""
    with suppress(HTTPError, OSError, ValueError):
        data = response.data
        packed = "msgpack" in response.headers.get("content-type", "")
        body = codec.unpack(data) if packed else json.loads(data)
    if isinstance(body, dict):
        return Problem.from_json(response.status, body)
    text = data.decode(errors="replace").strip()[:200]
    return Problem(response.status, text or "the server gave no reason", title=response.reason or "")


def parse_events(chunks: Iterable[bytes]) -> Iterator[Event]:
    """Parses server-sent events (WHATWG HTML, section 9.2) from chunks of bytes."""
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


def _is_unreachable(error: Exception) -> bool:
    return isinstance(error, (NewConnectionError, ConnectTimeoutError))


def _is_timeout(error: Exception) -> bool:
    return isinstance(error, (ReadTimeoutError, TimeoutError))


@lru_cache
def _split_path(path: str) -> list[tuple[str, str | None]]:
    """Splits `/v1/worlds/{id}/step` into `/v1/worlds/`, `{id}`, `/step`, each with the parameter's name or None."""
    parts = path.replace("{", "\0{").replace("}", "}\0").split("\0")
    return [(part, part[1:-1] if part.startswith("{") else None) for part in parts]


def _percent_encode(part: str) -> str:
    # Most ids need no encoding, and quote() is slow.
    return part if _SAFE(part) else quote(part, safe=":")
