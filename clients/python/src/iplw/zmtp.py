"""ZMTP 3.1, a DEALER's side of one connection: greeting, READY, frames (rfc.zeromq.org/spec/37).

Spoken here and not through libzmq, which passes every message through a thread of its own: two wake-ups more for a
request and its answer, as long as everything else together. NULL security only.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator, Sequence
from typing import Any
from urllib.parse import urlsplit

from .sockets import Line

MORE, LONG, COMMAND = 1, 2, 4
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01" + b"NULL".ljust(20, b"\0") + bytes(32)
#: Bytes read at a time; and the longest frame that goes out in one piece with its neighbours.
_CHUNK = 65536
#: Longest frame that is taken, bytes.
_MOST = 2**32


class Broken(OSError):
    """The connection ended."""


class Nonsense(ValueError):
    """What came is not what a ROUTER says."""


class Connection:
    """One connection to a ROUTER, never renewed, for one thread at a time."""

    def __init__(self, url: str, patience: float) -> None:
        """Connects; `OSError` if nobody answers within `patience` s, `Nonsense` if it is somebody else."""
        until = time.monotonic() + patience
        place = where(url)
        self._line = Line.unix(place, patience) if isinstance(place, str) else Line.tcp(*place, patience)
        #: How long a message may stop in the middle, s.
        self._patience = patience
        self._rest = b""
        #: Whether no message has gone out in part.
        self.whole = True
        try:
            self._line.wait_for(max(0.001, until - time.monotonic()))
            self._line.send(GREETING)
            check_greeting(self._exactly(64))
            self._line.send(command(READY))
            check_ready(*self._frame())
        except BaseException:
            self._line.close()
            raise

    def wait_for(self, patience: float, sending: float) -> None:
        """How long `receive` may hear nothing and `send` get rid of nothing, s."""
        self._line.wait_for(patience, sending)

    def send(self, frames: Sequence[Any]) -> None:
        """Sends one message; after an `OSError` the connection is of no use."""
        self.whole = False
        first = frames[0]
        if len(frames) == 1 and len(first) < 256:
            # Most requests.
            self._line.send(bytes((0, len(first))) + first)
        else:
            for piece in pieces(frames):
                self._line.send(piece)
        self.whole = True

    def receive(self) -> list[Any]:
        """The next message's frames; `TimeoutError` if nothing came, after which one may go on.

        A frame is `bytes`, or a `bytearray` of its own where it is long.
        """
        while True:
            rest = self._rest = self._rest or self._line.receive(_CHUNK)
            # One short frame and nothing after it: most answers.
            if len(rest) > 2 and rest[0] == 0 and len(rest) == rest[1] + 2:
                self._rest = b""
                return [rest[2:]]
            if not rest:
                raise Broken("the server hung up")
            frames: list[Any] = []
            # After a command nothing need come for as long as it likes.
            while frames or self._rest:
                flags, body = self._frame()
                if flags & COMMAND:
                    if body[:5] == PING:
                        self._line.send(command(PONG + bytes(body[7:])))
                    continue
                frames.append(body)
                if not flags & MORE:
                    return frames

    def dropped(self) -> bool:
        """Whether the connection has ended, or something came that nobody asked for."""
        return bool(self._rest) or self._line.stirs()

    def close(self) -> None:
        """Hangs up."""
        self._line.close()

    def _frame(self) -> tuple[int, Any]:
        flags, first = self._exactly(2)
        more = self._exactly(7) if flags & LONG else b""
        return flags, self._exactly(length_of(flags, bytes([first]) + more))

    def _exactly(self, length: int) -> Any:
        rest = self._rest
        if len(rest) >= length:
            self._rest = rest[length:]
            return rest[:length]
        self._rest = b""
        if length <= _CHUNK:
            while len(rest) < length:
                rest += self._more()
            self._rest = rest[length:]
            return rest[:length]
        # Straight to where it stays.
        whole = bytearray(length)
        whole[: len(rest)] = rest
        at, view = len(rest), memoryview(whole)
        while at < length:
            at += self._more(view[at:])
        return whole

    def _more(self, place: memoryview | None = None) -> Any:
        """Bytes, or how many were put in their place; in the middle of a message silence is an end."""
        until = time.monotonic() + self._patience
        while True:
            try:
                got = self._line.receive(_CHUNK) if place is None else self._line.receive_into(place)
            except TimeoutError:
                if time.monotonic() > until:
                    raise Broken("the server stopped in the middle of a message") from None
                continue
            if not got:
                raise Broken("the server hung up")
            return got


async def opened(url: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """The same for asyncio: a connection to a ROUTER; `OSError`, `EOFError` or `Nonsense` if that cannot be."""
    place = where(url)
    if isinstance(place, str):
        reader, writer = await asyncio.open_unix_connection(place)
    else:
        # asyncio sets TCP_NODELAY by itself.
        reader, writer = await asyncio.open_connection(*place)
    try:
        writer.write(GREETING)
        check_greeting(await reader.readexactly(64))
        writer.write(command(READY))
        check_ready(*await _frame_of(reader))
    except BaseException:
        writer.close()
        raise
    return reader, writer


async def receive(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> list[Any]:
    """The next message's frames."""
    frames: list[Any] = []
    while True:
        flags, body = await _frame_of(reader)
        if flags & COMMAND:
            if body[:5] == PING:
                writer.write(command(PONG + body[7:]))
            continue
        frames.append(body)
        if not flags & MORE:
            return frames


async def _frame_of(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    flags, first = await reader.readexactly(2)
    more = await reader.readexactly(7) if flags & LONG else b""
    return flags, await reader.readexactly(length_of(flags, bytes([first]) + more))


def where(url: str) -> tuple[str, int] | str:
    """Host and port of `tcp://HOST:PORT`, or the path of `ipc://PATH`."""
    if url.startswith("ipc://"):
        return url.removeprefix("ipc://")
    parts = urlsplit(url)
    return str(parts.hostname), int(parts.port or 0)


def pieces(frames: Sequence[Any]) -> Iterator[Any]:
    """What goes out for a message, small frames together."""
    last = len(frames) - 1
    together: list[Any] = []
    for i, frame in enumerate(frames):
        body = frame if isinstance(frame, bytes) else memoryview(frame).cast("B")
        length = len(body)
        together.append(_head(MORE if i < last else 0, length))
        if length <= _CHUNK:
            together.append(body)
        else:
            yield b"".join(together)
            yield body
            together = []
    if together:
        yield b"".join(together)


def command(body: bytes) -> bytes:
    """A command's frame."""
    return _head(COMMAND, len(body)) + body


def length_of(flags: int, length: bytes) -> int:
    """A frame's length, of one byte or eight."""
    if flags & ~(MORE | LONG | COMMAND):
        raise Nonsense(f"a frame with flags {flags:#x}")
    number = int.from_bytes(length, "big")
    if number > _MOST:
        raise Nonsense(f"a frame of {number} bytes")
    return number


def check_greeting(greeting: bytes) -> None:
    """Errors unless the other side speaks ZMTP 3 without security."""
    if greeting[0] != 0xFF or greeting[9] != 0x7F or greeting[10] < 3:
        raise Nonsense("no greeting of ZMTP 3")
    if greeting[12:32].rstrip(b"\0") != b"NULL":
        raise Nonsense("a mechanism other than NULL")


def check_ready(flags: int, body: bytes) -> None:
    """Errors unless the other side is ready."""
    if not flags & COMMAND or body[:6] != b"\x05READY":
        raise Nonsense(f"no READY but {bytes(body[:60])!r}")


def _head(flags: int, length: int) -> bytes:
    if length < 256:
        return bytes((flags, length))
    return bytes((flags | LONG,)) + length.to_bytes(8, "big")


def _property(name: bytes, value: bytes) -> bytes:
    return bytes([len(name)]) + name + len(value).to_bytes(4, "big") + value


READY = b"\x05READY" + _property(b"Socket-Type", b"DEALER") + _property(b"Identity", b"")
PING, PONG = b"\x04PING", b"\x04PONG"
