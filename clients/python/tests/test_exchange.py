"""HTTP/1.1 as servers and proxies may speak it, whole or in pieces of any size."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from peer import peer, say

from iplw.exchange import Broken, Connection


@contextmanager
def saying(answer: bytes, piece: int = 65536, hold: bool = False) -> Iterator[tuple[Connection, list[bytes]]]:
    """A connection to a server that gives this answer to the first request, `piece` bytes at a time."""
    got: list[bytes] = []

    def serve(connected: socket.socket, done: threading.Event) -> None:
        got.append(connected.recv(65536))
        say(connected, answer, piece)
        if hold:
            done.wait(10)

    with peer(serve) as port:
        connection = Connection("127.0.0.1", port, 5)
        try:
            yield connection, got
        finally:
            connection.close()


CHUNKED = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n4;x=y\r\ndefg\r\n0\r\nT: v\r\n\r\n"


@pytest.mark.parametrize("piece", [1, 2, 7, 65536])
@pytest.mark.parametrize(
    ("raw", "status", "data", "keep"),
    [
        (b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc", 200, b"abc", True),
        (CHUNKED, 200, b"abcdefg", True),
        (CHUNKED.replace(b"T: v\r\n", b""), 200, b"abcdefg", True),
        (b"HTTP/1.1 204 No Content\r\n\r\n", 204, b"", True),
        (b"HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 201 Made\r\ncontent-length:2\r\n\r\n{}", 201, b"{}", True),
        (b"HTTP/1.1 503 Busy\r\nConnection: Close\r\nContent-Length: 1\r\n\r\nx", 503, b"x", False),
        (b"HTTP/1.0 200 OK\r\n\r\nto the end", 200, b"to the end", False),
    ],
)
def test_answers_are_read_whole(raw: bytes, status: int, data: bytes, keep: bool, piece: int) -> None:
    with saying(raw, piece) as (connection, got):
        answer = connection.ask("POST", "/a?b=c", {"X": "1"}, b"body", 5)
        assert (answer.status, answer.data, answer.keep) == (status, data, keep)
    head, _, body = got[0].partition(b"\r\n\r\n")
    assert head.startswith(b"POST /a?b=c HTTP/1.1\r\nHost: 127.0.0.1:") and b"\r\nX: 1" in head
    assert b"\r\nContent-Length: 4" in head and body == b"body"


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"HTTP/1.1 200 OK\r\nContent-Le",
        b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nabc",
        b"HTTP/1.1 200 OK\r\nContent-Length: x\r\n\r\nabc",
        b"HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\nabc",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n9\r\nabc",
        b"SSH-2.0-OpenSSH\r\n\r\n",
        b"x" * 200_000,
    ],
)
def test_what_is_not_whole_is_broken(raw: bytes) -> None:
    with saying(raw) as (connection, _):
        with pytest.raises((Broken, ConnectionResetError)):
            connection.ask("GET", "/", {}, None, 5)


def test_silence_and_hanging_up_are_noticed() -> None:
    with saying(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n", hold=True) as (connection, _):
        connection.ask("GET", "/", {}, None, 5)
        assert not connection.dropped()
        with pytest.raises(TimeoutError):
            connection.ask("GET", "/", {}, None, 0.05)
    with saying(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n") as (connection, _):
        connection.ask("GET", "/", {}, None, 5)
        for _ in range(500):
            if connection.dropped():
                break
            threading.Event().wait(0.01)
        assert connection.dropped()


def test_nothing_is_smuggled_into_headers() -> None:
    with saying(b"HTTP/1.1 204 x\r\n\r\n") as (connection, got):
        for path, headers in (("/\r\nX: 1", {}), ("/", {"Idempotency-Key": "a\r\nX: 1"})):
            with pytest.raises(ValueError, match="line break"):
                connection.ask("POST", path, headers, None, 5)
        connection.ask("POST", "/", {}, None, 5)
    assert got[0].startswith(b"POST / HTTP/1.1\r\n")
