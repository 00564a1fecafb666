"""One HTTP/1.1 exchange at a time over a kept connection: what a step needs of HTTP and no more (RFC 9112).

General clients spend more time on a small request than the server does. TLS and streams are left to one of those; see
`http`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

from .sockets import Line

#: Most bytes of a status line and headers.
_HEAD = 65536
_READ = 65536


class Broken(OSError):
    """The connection ended, or what came is not HTTP."""


class Answer:
    """A response, read whole."""

    __slots__ = ("data", "headers", "keep", "reason", "status")

    def __init__(
        self, status: int, headers: Mapping[str, str], data: bytes, keep: bool, reason: str = ""
    ) -> None:
        self.status = status
        self.reason = reason
        #: Names in lower case.
        self.headers = headers
        self.data = data
        #: Whether the connection may be used again.
        self.keep = keep


class Connection:
    """A connection to one server, for one request after another."""

    def __init__(self, host: str, port: int, patience: float) -> None:
        """Connects; `OSError` if nobody listens, or not within `patience`, s."""
        self._host = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self._line = Line.tcp(host, port, patience)

    def dropped(self) -> bool:
        """Whether the server has hung up since the last answer (or says something unasked)."""
        return self._line.stirs()

    def ask(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes | None, patience: float
    ) -> Answer:
        """Sends a request and reads the answer; `TimeoutError` after `patience` s of silence, else `Broken`."""
        said = _written(tuple(headers.items()))
        if "\n" in path or "\r" in path or said is None:
            raise ValueError(f"a header or path of {method} {path!r} has a line break")
        if body is not None or method in ("POST", "PUT"):
            said = f"{said}Content-Length: {len(body or b'')}\r\n"
        message = f"{method} {path} HTTP/1.1\r\nHost: {self._host}\r\n{said}\r\n".encode("latin-1")
        self._line.wait_for(patience)
        # Written together where it is cheap: two small packets could wait for each other.
        if body is not None and len(body) > 2**17:
            self._line.send(message)
            self._line.send(body)
        else:
            self._line.send(message + body if body else message)
        return self._read(method)

    def close(self) -> None:
        """Hangs up."""
        self._line.close()

    def _read(self, method: str) -> Answer:
        rest = b""
        while True:
            while (end := rest.find(b"\r\n\r\n")) < 0:
                if len(rest) > _HEAD:
                    raise Broken("headers that do not end")
                rest += self._more()
            code, reason, headers, keep = _head(rest[:end])
            rest = rest[end + 4 :]
            # 1xx announces another.
            if code >= 200:
                break
        if method == "HEAD" or code in (204, 304):
            data = b""
        elif "transfer-encoding" in headers and headers["transfer-encoding"].lower() == "chunked":
            data = self._chunks(rest)
        elif "content-length" in headers:
            data = self._exactly(rest, _number(headers["content-length"], 10))
        else:
            data, keep = self._all(rest), False
        return Answer(code, headers, data, keep, reason)

    def _more(self) -> bytes:
        data = self._line.receive(_READ)
        if not data:
            raise Broken("the server hung up")
        return data

    def _exactly(self, rest: bytes, length: int) -> bytes:
        if len(rest) >= length:
            return rest[:length]
        whole = bytearray(length)
        whole[: len(rest)] = rest
        at, view = len(rest), memoryview(whole)
        while at < length:
            n = self._line.receive_into(view[at:])
            if n == 0:
                raise Broken(f"the server hung up after {at} of {length} bytes")
            at += n
        return bytes(whole)

    def _chunks(self, rest: bytes) -> bytes:
        parts: list[bytes] = []
        while True:
            while (end := rest.find(b"\r\n")) < 0:
                rest += self._more()
            size = _number(rest[:end].split(b";")[0].decode("latin-1"), 16)
            rest = rest[end + 2 :]
            if size == 0:
                # Trailers, up to an empty line.
                while not rest.startswith(b"\r\n") and b"\r\n\r\n" not in rest:
                    rest += self._more()
                return b"".join(parts)
            if len(rest) < size + 2:
                rest += self._exactly(b"", size + 2 - len(rest))
            parts.append(rest[:size])
            rest = rest[size + 2 :]

    def _all(self, rest: bytes) -> bytes:
        parts = [rest]
        while data := self._line.receive(_READ):
            parts.append(data)
        return b"".join(parts)


@lru_cache(64)
def _written(headers: tuple[tuple[str, str], ...]) -> str | None:
    """Headers as they are sent, or None if one would be two; clients send the same few again and again."""
    lines = [f"{name}: {value}" for name, value in headers]
    said = "".join(lines)
    return None if "\n" in said or "\r" in said else "".join(f"{line}\r\n" for line in lines)


@lru_cache(64)
def _head(head: bytes) -> tuple[int, str, Mapping[str, str], bool]:
    """Status, reason, headers and whether the connection stays; servers say the same for a second at least."""
    first, *lines = head.decode("latin-1").split("\r\n")
    version, _, status = first.partition(" ")
    if not version.startswith("HTTP/1.") or not status[:3].isdigit():
        raise Broken(f"{first[:60]!r} is not HTTP")
    headers: dict[str, str] = {}
    for line in lines:
        name, _, value = line.partition(":")
        headers[name.lower()] = value.strip()
    keep = version == "HTTP/1.1" and headers.get("connection", "").lower() != "close"
    return int(status[:3]), status[4:], MappingProxyType(headers), keep


def _number(text: str, base: int) -> int:
    try:
        number = int(text.strip(), base)
    except ValueError:
        number = -1
    if number < 0:
        raise Broken(f"{text[:20]!r} is no length")
    return number
