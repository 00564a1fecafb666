"""Connected sockets that give up after a while, at the price of one system call a send or receive.

Python's own timeouts cost a poll() each time, which a small request notices.
"""

from __future__ import annotations

import select
import socket
import struct
import sys

#: `struct timeval` is two longs there, and select() would not take large numbers of files.
_UNIX = sys.platform != "win32"


class Line:
    """A connected stream. Silence raises `TimeoutError`, a lost connection another `OSError`."""

    def __init__(self, connected: socket.socket) -> None:
        self.socket = connected
        self._patience: float | None = None
        self._sending: float | None = None
        if _UNIX:
            connected.settimeout(None)
            self._poll = select.poll()
            self._poll.register(connected, select.POLLIN | select.POLLPRI)

    @classmethod
    def tcp(cls, host: str, port: int, patience: float) -> Line:
        """Connects; `OSError` if nobody listens, or not within `patience`, s."""
        made = socket.create_connection((host, port), patience)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return cls(made)

    @classmethod
    def unix(cls, path: str, patience: float) -> Line:
        """The same at a path of the file system."""
        made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            made.settimeout(patience)
            made.connect(path)
        except BaseException:
            made.close()
            raise
        return cls(made)

    def wait_for(self, patience: float, sending: float | None = None) -> None:
        """How long a receive may hear nothing and a send get rid of nothing (as long, if not said), s."""
        sending = patience if sending is None else sending
        if patience == self._patience and sending == self._sending:
            return
        self._patience, self._sending = patience, sending
        if _UNIX:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(patience))
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(sending))

    def send(self, data: bytes | memoryview) -> None:
        """Sends all of it."""
        if not _UNIX:
            self.socket.settimeout(self._sending)
        try:
            self.socket.sendall(data)
        except BlockingIOError:
            raise TimeoutError("timed out") from None

    def receive(self, most: int) -> bytes:
        """What there is, up to `most` bytes; empty at the end."""
        if not _UNIX:
            self.socket.settimeout(self._patience)
        try:
            return self.socket.recv(most)
        except BlockingIOError:
            raise TimeoutError("timed out") from None

    def receive_into(self, place: memoryview) -> int:
        """How many bytes were received; 0 at the end."""
        if not _UNIX:
            self.socket.settimeout(self._patience)
        try:
            return self.socket.recv_into(place)
        except BlockingIOError:
            raise TimeoutError("timed out") from None

    def stirs(self) -> bool:
        """Whether there is something to receive, the end included."""
        if _UNIX:
            return bool(self._poll.poll(0))
        return bool(select.select([self.socket], [], [], 0)[0])

    def close(self) -> None:
        """Hangs up."""
        try:
            self.socket.close()
        except OSError:
            pass


def _timeval(seconds: float) -> bytes:
    return struct.pack("@ll", *divmod(max(1, round(1e6 * min(seconds, 1e9))), 1_000_000))
