"""HTTP by urllib3: MessagePack in and out where it is installed, else JSON.

Connections are kept, TLS is `https://` with the system's certificates, and a proxy is the environment's
(`HTTP_PROXY`, `HTTPS_PROXY`, `NO_PROXY`), never for a server on this machine.
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
from .call import Call
from .errors import Problem, ServerUnavailable
from .operations import OPERATIONS
from .transport import CONNECT, KEPT, Event, Lost, Stream, Transport, closed

_JSON = "application/json"
_PACKED = "application/msgpack"
_CSV = "text/csv"
_BYTES = "application/octet-stream"
_ACCEPT_JSON = f"{_JSON}, application/problem+json"
_ACCEPT_RAW = f"{_PACKED}; arrays=raw"
#: Repeats are ours to decide. Made once: urllib3 would make one for every request.
_ONCE = Retry(False, redirect=False)
#: Refusals of a gateway, which knows nothing of what was asked.
_GATEWAY = (502, 503, 504)
#: What stands in a path as it is.
_SAFE = re.compile(r"[A-Za-z0-9_.~:-]+").fullmatch


class Http(Transport):
    """Kept connections to one server."""

    _start = "iplw serve"
    _what = "an iplw server"

    def __init__(
        self,
        url: str,
        timeout: float,
        advice: Callable[[], str] | None = None,
        token: str | None = None,
        verify: bool | str = True,
    ) -> None:
        super().__init__(url.rstrip("/"), timeout, advice)
        self._who = {} if token is None else {"Authorization": f"Bearer {token}"}
        self._verify = verify
        self._pool: _Pool | None = None
        self._pid = os.getpid()
        self._closed = False

    def events(self, job: str, last_id: str, patience: float) -> Stream:
        """Server-sent events."""
        headers = {"Accept": "text/event-stream", "Cache-Control": "no-cache"}
        if last_id:
            headers["Last-Event-ID"] = last_id
        slack = min(0.0, max(patience, 0.01) - self.timeout)
        path = f"/v1/jobs/{_quoted(job)}/events"
        return _Events(
            lambda: self._ask("GET", path, None, headers, slack, stream=True),
            lambda error: self._unavailable(f"GET {path}", True, error),
        )

    def close(self) -> None:
        """Drops the connections; a second call does nothing."""
        self._closed = True
        pool, self._pool = self._pool, None
        if pool is not None and self._pid == os.getpid():
            pool.close()

    def _once(self, call: Call[Any], given_up: threading.Event | None) -> Any:
        operation = OPERATIONS[call.op]
        path, headers, payload = request(call)
        what = f"{operation.method} {path}"
        try:
            response = self._ask(operation.method, path, payload, headers, call.slack)
        except (HTTPError, OSError) as error:
            lost = error
            # Nobody there is nobody there; silence has cost its time already.
            if _is_nobody(error) or _is_silence(error):
                raise self._unavailable(what, call.repeatable, error) from error
            raise Lost(lambda: self._unavailable(what, call.repeatable, lost)) from error
        data = response.data
        if response.status >= 300:
            refused = problem(response)
            # What took too long takes too long again.
            passes = response.status in _GATEWAY and refused.slug != "deadline"
            raise Lost(lambda: refused) if passes else refused
        if not data:
            # Headers that break off are taken for whole ones, without a body.
            if operation.gives and response.status != 204:
                raise Lost(lambda: self._broke(what, call.repeatable, "an empty answer"))
            return None
        if call.binary:
            return data
        try:
            if response.headers.get("content-type", "").startswith(_PACKED):
                return codec.unpack(data)
            # Decoded here, since json would first look for other encodings.
            return json.loads(data.decode())
        except ValueError as error:
            raise self._nonsense(call.op, f"something other than JSON ({data[:60]!r})") from error

    def _ask(
        self,
        method: str,
        path: str,
        payload: bytes | None,
        headers: Mapping[str, str],
        slack: float,
        stream: bool = False,
    ) -> urllib3.BaseHTTPResponse:
        pool = self._pool
        if pool is None or self._pid != os.getpid():
            if self._closed:
                raise closed()
            # A forked child must not talk over its parent's sockets.
            pool, self._pid = _Pool(self.url, self._verify), os.getpid()
            self._pool = pool
        return pool.open(
            method,
            pool.base + path,
            body=payload,
            headers={**headers, **self._who},
            retries=_ONCE,
            redirect=False,
            timeout=Timeout(connect=min(self.timeout, CONNECT), read=self.timeout + slack),
            preload_content=not stream,
        )

    def _unavailable(self, what: str, repeatable: bool, error: Exception) -> ServerUnavailable:
        if _is_silence(error):
            return self._silent(what)
        return self._nobody() if _is_nobody(error) else self._broke(what, repeatable, str(error))


class _Pool:
    """urllib3's connections to one server, straight or through a proxy."""

    def __init__(self, url: str, verify: bool | str) -> None:
        parts = urlsplit(url)
        trust: dict[str, Any] = {}
        if parts.scheme == "https" and verify is not True:
            trust = {"ca_certs": verify} if isinstance(verify, str) else {"cert_reqs": "CERT_NONE"}
        host = str(parts.hostname)
        here = host in ("localhost", "::1") or host.startswith("127.")
        proxy = None if here or proxy_bypass(host) else getproxies().get(parts.scheme)
        self.open: Callable[..., urllib3.BaseHTTPResponse]
        if proxy:
            manager = urllib3.ProxyManager(proxy, maxsize=KEPT, **trust)
            #: What a path is put behind.
            self.base = url
            self.open, self.close = manager.urlopen, manager.clear
        else:
            pool = urllib3.connection_from_url(url, maxsize=KEPT, **trust)
            if parts.scheme == "http":
                pool.ConnectionCls = _Connection
            self.base = parts.path.rstrip("/")
            self.open, self.close = pool.urlopen, pool.close


class _Connection(HTTPConnection):
    """Sends the head of a request and its body as one: two packets would wake the server twice."""

    _held: list[bytes] | None = None

    def request(self, *args: Any, **settings: Any) -> None:
        self._held = []
        try:
            super().request(*args, **settings)
        finally:
            held, self._held = b"".join(self._held), None
        self.send(held)

    def send(self, data: Any) -> None:
        if self._held is None:
            super().send(data)
        else:
            self._held.append(data)


class _Events(Stream):
    """A response that goes on, as events."""

    def __init__(
        self,
        ask: Callable[[], urllib3.BaseHTTPResponse],
        unavailable: Callable[[Exception], ServerUnavailable],
    ) -> None:
        self._ask = ask
        self._unavailable = unavailable
        self._response: urllib3.BaseHTTPResponse | None = None
        self._stopped = False
        self._events = self._read()

    def __next__(self) -> Event:
        return next(self._events)

    def stop(self) -> None:
        self._stopped = True
        if self._response is not None:
            # It may have ended by itself.
            with suppress(RuntimeError, ValueError, OSError):
                self._response.shutdown()
        # Whoever waits for the next event in another thread closes it.
        with suppress(ValueError):
            self._events.close()

    def _read(self) -> Generator[Event]:
        try:
            self._response = response = self._ask()
            try:
                if response.status >= 300:
                    raise problem(response)
                if not self._stopped:
                    yield from parse(response.stream(65536))
            finally:
                # The rest of the stream is of no use, so neither is its connection.
                response.close()
        except (HTTPError, OSError) as error:
            raise self._unavailable(error) from error


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
        kind, payload = _CSV, str(rest.pop("csv")).encode()
    elif _BYTES in operation.takes:
        kind, payload = _BYTES, rest.pop("body")
    elif operation.takes:
        kind, payload = (_PACKED, codec.pack(rest)) if packed else (_JSON, codec.to_json(rest))
        rest = {}
    if kind:
        headers["Content-Type"] = kind
    if call.key is not None:
        headers["Idempotency-Key"] = call.key
    return address + ("?" + urlencode(rest) if rest else ""), headers, payload


def problem(response: urllib3.BaseHTTPResponse) -> Problem:
    """What a refusal says."""
    said: Any = None
    data = b""
    with suppress(HTTPError, OSError, ValueError):
        data = response.data
        packed = "msgpack" in response.headers.get("content-type", "")
        said = codec.unpack(data) if packed else json.loads(data)
    if isinstance(said, dict):
        return Problem.from_json(response.status, said)
    text = data.decode(errors="replace").strip()[:200]
    return Problem(response.status, text or "the server gave no reason", title=response.reason or "")


def parse(chunks: Iterable[bytes]) -> Iterator[Event]:
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


def _is_nobody(error: Exception) -> bool:
    return isinstance(error, (NewConnectionError, ConnectTimeoutError))


def _is_silence(error: Exception) -> bool:
    return isinstance(error, (ReadTimeoutError, TimeoutError))


@lru_cache
def _parts(path: str) -> list[tuple[str, str | None]]:
    """`/v1/worlds/{id}/step` as `/v1/worlds/`, `{id}`, `/step`, with the names of what is to be put in."""
    parts = path.replace("{", "\0{").replace("}", "}\0").split("\0")
    return [(part, part[1:-1] if part.startswith("{") else None) for part in parts]


def _quoted(part: str) -> str:
    # Most ids need nothing done, and quote() takes its time.
    return part if _SAFE(part) else quote(part, safe=":")
