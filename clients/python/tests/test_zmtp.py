"""ZMTP as any peer may speak it, whole or in pieces of any size; and libzmq as the other side of client and server."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import pytest
import zmq
from peer import peer, say

import iplw
from iplw import zmtp

READY = zmtp.command(b"\x05READY\x0bSocket-Type\x00\x00\x00\x06ROUTER")
LONG = b"\x02" + (70_000).to_bytes(8, "big") + b"x" * 70_000
PING = zmtp.command(b"\x04PING\x00\x00why")


@contextmanager
def saying(answer: bytes, piece: int = 65536, hold: bool = False) -> Iterator[tuple[str, list[bytes]]]:
    """A peer that says this after its greeting, whatever it hears; what it heard."""
    heard: list[bytes] = [b""]

    def serve(connected: socket.socket, done: threading.Event) -> None:
        # One that holds does not hang up; the other does once the client is quiet, or has done so itself.
        connected.settimeout(0.2)
        try:
            say(connected, answer, piece)
            while part := connected.recv(65536):
                heard[0] += part
        except OSError:
            pass
        if hold:
            done.wait(10)

    with peer(serve) as port:
        yield f"tcp://127.0.0.1:{port}", heard


@pytest.mark.parametrize("piece", [1, 7, 65536])
def test_messages_come_whole(piece: int) -> None:
    first, second = b"\x00\x03abc", b"\x01\x00" + b"\x03" + LONG[1:] + PING + b"\x00\x01z"
    said = zmtp.GREETING + READY + first + PING + second
    if piece == 1:
        said = said.replace(LONG[1:], (300).to_bytes(8, "big") + b"x" * 300)
    with saying(said, piece) as (url, heard):
        line = zmtp.Connection(url, 5)
        line.wait_for(5, 5)
        assert line.receive() == [b"abc"]
        empty, long, last = line.receive()
        assert (empty, bytes(long), last) == (b"", b"x" * (300 if piece == 1 else 70_000), b"z")
        line.send([b"k" * 300, b""])
        line.send([b"short"])
        line.close()
    assert heard[0].startswith(zmtp.GREETING + zmtp.command(zmtp.READY))
    pongs, sent = zmtp.command(b"\x04PONGwhy"), b"\x03" + (300).to_bytes(8, "big") + b"k" * 300 + b"\x00\x00\x00\x05short"
    assert heard[0].endswith(pongs * 2 + sent)


@pytest.mark.parametrize("piece", [1, 65536])
def test_messages_come_whole_to_asyncio(piece: int) -> None:
    async def received(url: str) -> list[Any]:
        reader, writer = await zmtp.opened(url)
        got = [await zmtp.receive(reader, writer) for _ in range(2)]
        with pytest.raises(EOFError):
            await zmtp.receive(reader, writer)
        writer.close()
        return got

    with saying(zmtp.GREETING + READY + PING + b"\x00\x03abc\x01\x01a\x00\x00", piece) as (url, _):
        assert asyncio.run(received(url)) == [[b"abc"], [b"a", b""]]


@pytest.mark.parametrize(
    "said",
    [
        b"HTTP/1.1 400 Bad Request\r\n\r\n" + b" " * 64,
        zmtp.GREETING.replace(b"NULL", b"CURV") + READY,
        zmtp.GREETING[:10] + b"\x02" + zmtp.GREETING[11:] + READY,
        zmtp.GREETING + zmtp.command(b"\x05ERROR\x02no"),
        zmtp.GREETING + b"\x00\x02hi",
        zmtp.GREETING + b"\xf0\x02hi",
        zmtp.GREETING + b"\x06" + (2**62).to_bytes(8, "big"),
        zmtp.GREETING[:30],
        b"",
    ],
)
def test_who_is_no_router_is_not_talked_to(said: bytes) -> None:
    with saying(said) as (url, _):
        with pytest.raises((OSError, zmtp.Nonsense)):
            zmtp.Connection(url, 1)
    with saying(said) as (url, _):
        with pytest.raises(iplw.ServerUnavailable, match="no iplw server at tcp://"):
            iplw.Client(url, timeout=1).worlds()


def test_silence_may_be_waited_out_but_not_in_the_middle() -> None:
    with saying(zmtp.GREETING + READY, hold=True) as (url, _):
        line = zmtp.Connection(url, 0.3)
        line.wait_for(0.05, 5)
        assert not line.dropped()
        for _ in range(2):
            with pytest.raises(TimeoutError):
                line.receive()
        line.close()
    with saying(zmtp.GREETING + READY + b"\x00\x05ab", hold=True) as (url, _):
        line = zmtp.Connection(url, 0.3)
        line.wait_for(0.05, 5)
        start = time.monotonic()
        with pytest.raises(zmtp.Broken, match="in the middle"):
            line.receive()
        assert 0.2 < time.monotonic() - start < 3
        line.close()


def test_hanging_up_is_noticed() -> None:
    with saying(zmtp.GREETING + READY) as (url, _):
        line = zmtp.Connection(url, 5)
        line.wait_for(5, 5)
        with pytest.raises(zmtp.Broken, match="hung up"):
            line.receive()
        assert line.dropped()
        line.close()


def test_libzmq_talks_to_the_server_as_our_client_does() -> None:
    with iplw.Client("tcp://private") as client:
        dealer: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        dealer.linger = 0
        dealer.setsockopt(zmq.HEARTBEAT_IVL, 50)
        dealer.rcvtimeo = 10_000
        dealer.connect(client.url)
        time.sleep(0.3)
        # `args` may come before `op`, and an id of any kind.
        header = {"args": {"id": "bowling-sim", "seed": 3}, "id": b"mine", "op": "reset_world", "v": 1, "raw": True}
        dealer.send_multipart([msgpack.packb(header)])
        head, observation = dealer.recv_multipart()
        said = msgpack.unpackb(head)
        dealer.close()
        expected, info = client.world("bowling-sim").reset(seed=3)
        assert (said["id"], said["ok"], said["result"]["info"]) == (b"mine", True, info)
        assert observation == expected.tobytes()
