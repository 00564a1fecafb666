"""Starts a server, and provides small HTTP and ZeroMQ clients that need only the standard library."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import selectors
import socket
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path


class Server:
    """A running server: its ports and its process."""

    def __init__(self, process: subprocess.Popen[str], http: int, zmq: int | None):
        self.process, self.http, self.zmq, self.pid = process, http, zmq, process.pid

    def connect(self) -> http.client.HTTPConnection:
        return http.client.HTTPConnection("127.0.0.1", self.http)

    def processor_seconds(self) -> float:
        """Processor time of the server, s (clock_getcpuclockid(3), with Linux's clock numbers)."""
        return time.clock_gettime((~self.pid << 3) | 2)

    def resident(self) -> float:
        """Resident memory, MB."""
        pages = int(Path(f"/proc/{self.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@contextlib.contextmanager
def server(
    binary: str, *arguments: str, limits: dict[str, float] | None = None, zmq: bool = False
) -> Iterator[Server]:
    with tempfile.TemporaryDirectory() as place:
        file = Path(place, "limits.json")
        file.write_text(json.dumps(limits or {}))
        command = [binary, "serve", "--http", "127.0.0.1:0", "--limits", str(file), *arguments]
        command += ["--zmq", "tcp://127.0.0.1:*"] if zmq else []
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert process.stdout is not None
            ports = [int(process.stdout.readline().rsplit(":", 1)[1]) for _ in range(1 + zmq)]
            yield Server(process, ports[0], ports[1] if zmq else None)
        finally:
            process.terminate()
            process.wait()


def new_token(binary: str, directory: str, name: str, scope: str = "act") -> str:
    command = [binary, "token", "new", name, "--scope", scope, "--data-dir", directory]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def ask(
    connection: http.client.HTTPConnection, method: str, path: str, body: object = None, **headers: str
) -> tuple[int, dict[str, object]]:
    said = None if body is None else json.dumps(body)
    connection.request(method, path, said, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    is_json = "json" in answer.headers.get("Content-Type", "")
    told = answer.read()
    return answer.status, json.loads(told) if is_json and told else {}


def packed(value: object) -> bytes:
    """Minimal msgpack encoder for requests."""
    if value is None:
        return b"\xc0"
    if isinstance(value, bool):
        return b"\xc3" if value else b"\xc2"
    if isinstance(value, int):
        return b"\xcf" + struct.pack(">Q", value)
    if isinstance(value, float):
        return b"\xcb" + struct.pack(">d", value)
    if isinstance(value, str):
        return b"\xdb" + struct.pack(">I", len(value.encode())) + value.encode()
    if isinstance(value, list):
        return b"\xdd" + struct.pack(">I", len(value)) + b"".join(packed(item) for item in value)
    assert isinstance(value, dict)
    pairs = (packed(name) + packed(item) for name, item in value.items())
    return b"\xdf" + struct.pack(">I", len(value)) + b"".join(pairs)


def message(op: str, args: dict[str, object]) -> bytes:
    """ZeroMQ frame of a request."""
    body = packed({"v": 1, "id": 1, "op": op, "args": args})
    return b"\x02" + struct.pack(">Q", len(body)) + body


def dealer(port: int, token: str | None) -> socket.socket:
    """A socket after the ZMTP 3.1 handshake: NULL, or PLAIN with the token."""
    one = socket.create_connection(("127.0.0.1", port))
    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    mechanism = b"PLAIN" if token else b"NULL"
    one.sendall(b"\xff" + bytes(8) + b"\x7f\x03\x01" + mechanism.ljust(20, b"\0") + bytes(32))
    received(one, 64)
    metadata = b"\x0bSocket-Type\x00\x00\x00\x06DEALER"
    if token:
        command(one, b"\x05HELLO\x04iplw" + bytes([len(token)]) + token.encode())
        assert frame(one)[1] == b"\x07WELCOME"
        command(one, b"\x08INITIATE" + metadata)
    else:
        command(one, b"\x05READY" + metadata)
    assert frame(one)[1].startswith(b"\x05READY")
    return one


def command(one: socket.socket, body: bytes) -> None:
    one.sendall(bytes([4, len(body)]) + body)


def received(one: socket.socket, length: int) -> bytes:
    got = b""
    while len(got) < length:
        part = one.recv(length - len(got))
        assert part, "connection closed"
        got += part
    return got


def frame(one: socket.socket) -> tuple[int, bytes]:
    """Flags and body of the next frame."""
    flags, length = received(one, 2)
    if flags & 2:
        length = int.from_bytes(bytes([length]) + received(one, 7), "big")
    return flags, received(one, length)


def whole_over_http(got: bytes) -> bool:
    """Whether a complete response has arrived; it must be successful."""
    head, found, body = got.partition(b"\r\n\r\n")
    if not found:
        return False
    assert head.startswith(b"HTTP/1.1 200"), got[:300]
    length = next(line for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:"))
    return len(body) >= int(length.split(b":")[1])


def whole_over_zmq(got: bytes) -> bool:
    """As `whole_over_http`, for ZeroMQ responses of one frame."""
    if len(got) < 2 or (got[0] & 2 and len(got) < 9):
        return False
    head, length = (9, int.from_bytes(got[1:9], "big")) if got[0] & 2 else (2, got[1])
    if len(got) < head + length:
        return False
    assert b"\xa2ok\xc3" in got[:64], got[:300]
    return True


def flood(
    connect: Callable[[], socket.socket], request: bytes, whole: Callable[[bytes], bool], count: int,
    seconds: float, tell: Connection,
) -> None:
    """Sends requests over several connections, each after the previous response; returns the number of responses."""
    select = selectors.DefaultSelector()
    for _ in range(count):
        one = connect()
        select.register(one, selectors.EVENT_READ, bytearray())
    tell.send("ready")
    tell.recv()
    for key in list(select.get_map().values()):
        key.fileobj.sendall(request)  # type: ignore[union-attr]
    served, until = 0, time.perf_counter() + seconds
    while time.perf_counter() < until:
        for key, _ in select.select(0.1):
            key.data.extend(key.fileobj.recv(1 << 20))  # type: ignore[union-attr]
            if whole(bytes(key.data)):
                served += 1
                key.data.clear()
                key.fileobj.sendall(request)  # type: ignore[union-attr]
    tell.send(served)
