"""One HTTP/1.1 exchange at a time over a kept connection: what a step needs of HTTP and no more (RFC 9112).

General clients spend more time on a small request than the server does. TLS and streams are left to one of those; see
`http`.
"""

from __future__ import annotations

import socket
from collections.abc import Mapping
from contextlib import suppress

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
        self._socket = socket.create_connection((host, port), patience)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def dropped(self) -> bool:
        """Whether the server has hung up since the last answer (or says something unasked)."""
        # Not select(): a program may have more than a thousand files open.
        self._socket.setblocking(False)
        try:
            self._socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            pass
        return True

    def ask(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes | None, patience: float
    ) -> Answer:
        """Sends a request and reads the answer; `TimeoutError` after `patience` s of silence, else `Broken`."""
        lines = [f"{method} {path} HTTP/1.1\r\nHost: {self._host}"]
        lines += [f"{name}: {value}" for name, value in headers.items()]
        if body is not None or method in ("POST", "PUT"):
            lines.append(f"Content-Length: {len(body or b'')}")
        head = "\r\n".join(lines) + "\r\n\r\n"
        said = path + "".join(headers.values())
        if "\n" in said or "\r" in said:
            raise ValueError(f"a header or path of {method} {path!r} has a line break")
        self._socket.settimeout(patience)
        message = head.encode("latin-1")
        # Written together where it is cheap: two small packets could wait for each other.
        if body is not None and len(body) > 2**17:
            self._socket.sendall(message)
            self._socket.sendall(body)
        else:
            self._socket.sendall(message + body if body else message)
        return self._read(method)

    def close(self) -> None:
        """Hangs up."""
        with suppress(OSError):
            self._socket.close()

    def _read(self, method: str) -> Answer:
        rest = b""
        while True:
            while (end := rest.find(b"\r\n\r\n")) < 0:
                if len(rest) > _HEAD:
                    raise Broken("headers that do not end")
                rest += self._more()
            first, *lines = rest[:end].decode("latin-1").split("\r\n")
            rest = rest[end + 4 :]
            version, _, status = first.partition(" ")
            if not version.startswith("HTTP/1.") or not status[:3].isdigit():
                raise Broken(f"{first[:60]!r} is not HTTP")
            code = int(status[:3])
            # 1xx announces another.
            if code >= 200:
                break
        headers: dict[str, str] = {}
        for line in lines:
            name, _, value = line.partition(":")
            headers[name.lower()] = value.strip()
        keep = version == "HTTP/1.1" and headers.get("connection", "").lower() != "close"
        if method == "HEAD" or code in (204, 304):
            data = b""
        elif headers.get("transfer-encoding", "").lower() == "chunked":
            data = self._chunks(rest)
        elif "content-length" in headers:
            data = self._exactly(rest, _number(headers["content-length"], 10))
        else:
            data, keep = self._all(rest), False
        return Answer(code, headers, data, keep, status[4:])

    def _more(self) -> bytes:
        data = self._socket.recv(_READ)
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
            n = self._socket.recv_into(view[at:])
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
        while data := self._socket.recv(_READ):
            parts.append(data)
        return b"".join(parts)


def _number(text: str, base: int) -> int:
    try:
        number = int(text.strip(), base)
    except ValueError:
        number = -1
    if number < 0:
        raise Broken(f"{text[:20]!r} is no length")
    return number
