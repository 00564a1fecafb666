"""A private server: found, started, shared by every client of this process, and never left behind.

The server runs with `--exit-with-stdin` and a pipe from us on its standard input. However this process ends,
SIGKILL included, the system closes the pipe and the server stops.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path

from .binary import HOW, find_binary
from .errors import ServerUnavailable

#: How long a server may take to say where it listens, s.
START_TIMEOUT = 20.0
#: How long a server may take to stop by itself before it is made to, s.
STOP_TIMEOUT = 5.0
_MARK = "listening on "
_ARGUMENTS = ("serve", "--http", "127.0.0.1:0", "--zmq", "tcp://127.0.0.1:0", "--exit-with-stdin")


class PrivateServer:
    """One running `iplw serve`. Get it from `acquire`, give it back with `release`."""

    def __init__(self, binary: Path) -> None:
        self.binary = binary
        self.users = 0
        self._lines: deque[str] = deque(maxlen=40)
        self._found = threading.Condition()
        #: Scheme -> address, as it says them.
        self._addresses: dict[str, str] = {}
        self._ended = False
        try:
            # A session of its own: Ctrl-C in the terminal is Python's to handle, not the server's.
            self._process = subprocess.Popen(
                [str(binary), *_ARGUMENTS],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # Tokens of the environment are for servers that others reach; this one is ours alone.
                env={name: value for name, value in os.environ.items() if name != "IPLW_TOKENS"},
            )
        except OSError as error:
            raise ServerUnavailable(f"cannot start {binary}: {error}; {HOW}") from error
        self._reader = threading.Thread(target=self._read, name="iplw-server-output", daemon=True)
        self._reader.start()
        #: Its HTTP address.
        self.url = self._wait("http")

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def address(self, scheme: str) -> str:
        """Where it listens, `http` or `tcp`."""
        return self._addresses.get(scheme) or self._wait(scheme)

    def advice(self) -> str:
        """What to tell someone whose request failed; empty if the server is fine as far as we know."""
        if self.pid in _inherited:
            return ""
        with suppress(subprocess.TimeoutExpired):
            # A connection breaks a moment before the process is seen to be gone.
            code = self._process.wait(timeout=0.5)
            return (
                f"the private server has stopped (exit code {code}); make a new iplw.Client(){self._tail()}"
            )
        return ""

    def stop(self) -> None:
        """Stops the process and waits for it."""
        self.forget()
        try:
            self._process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(STOP_TIMEOUT)
        if self._process.stdout is not None and not self._reader.is_alive():
            self._process.stdout.close()

    def forget(self) -> None:
        """Lets go of the pipe that keeps the server alive."""
        if self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()

    def _read(self) -> None:
        # Read to the end, so that the server never blocks on a full pipe.
        assert self._process.stdout is not None
        for raw in self._process.stdout:
            line = raw.decode(errors="replace").rstrip()
            self._lines.append(line)
            if _MARK in line:
                address = line.partition(_MARK)[2].split()[0].rstrip("/")
                with self._found:
                    self._addresses.setdefault(address.partition(":")[0], address)
                    self._found.notify_all()
        with self._found:
            self._ended = True
            self._found.notify_all()

    def _wait(self, scheme: str) -> str:
        with self._found:
            self._found.wait_for(lambda: scheme in self._addresses or self._ended, START_TIMEOUT)
            if scheme in self._addresses:
                return self._addresses[scheme]
            ended = self._ended
        # Either it ended without a word or it is stuck; do not leave it about.
        self.stop()
        how = (
            f"ended with code {self._process.returncode}" if ended else f"was silent for {START_TIMEOUT:g} s"
        )
        raise ServerUnavailable(
            f"`{self.binary} {' '.join(_ARGUMENTS)}` {how} instead of printing "
            f"`listening on {scheme}://...`; {HOW}{self._tail()}"
        )

    def _tail(self) -> str:
        lines = list(self._lines)[-5:]
        return "; it last said:\n  " + "\n  ".join(lines) if lines else ""


def acquire(binary: str | os.PathLike[str] | None = None) -> PrivateServer:
    """The process's server for this binary, started if there is none."""
    path = find_binary(binary)
    with _lock:
        server = _servers.get(path)
        if server is None or not server.running:
            server = _servers[path] = PrivateServer(path)
        server.users += 1
        return server


def release(server: PrivateServer) -> None:
    """Gives a server back; the last user's return stops it."""
    with _lock:
        server.users -= 1
        if server.users > 0:
            return
        if _servers.get(server.binary) is server:
            del _servers[server.binary]
    if server.pid not in _inherited:
        server.stop()


_lock = threading.Lock()
_servers: dict[Path, PrivateServer] = {}
#: Servers that belong to the process we were forked from.
_inherited: set[int] = set()


def _stop_all() -> None:
    with _lock:
        servers = list(_servers.values())
        _servers.clear()
    for server in servers:
        server.stop()


def _after_fork() -> None:
    # The parent's server is the parent's: hold no end of its pipe, stop nothing, start our own when needed.
    global _lock
    _lock = threading.Lock()
    for server in _servers.values():
        _inherited.add(server.pid)
        server.forget()
    _servers.clear()


atexit.register(_stop_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
