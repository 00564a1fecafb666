"""A private server, started on demand and shared by the clients of this process.

The server runs with `--exit-with-stdin` and a pipe as its standard input. When this process ends, even by SIGKILL, the
system closes the pipe and the server stops.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path

from .binary import INSTALL_HINT, find_binary
from .errors import ServerUnavailable

#: Time for a server to report its addresses, s.
START_TIMEOUT = 20.0
#: Time for a server to stop before it is killed, s.
STOP_TIMEOUT = 5.0
_LISTENING = "listening on "
_ARGUMENTS = ("serve", "--http", "127.0.0.1:0", "--zmq", "tcp://127.0.0.1:0", "--exit-with-stdin")


class PrivateServer:
    """One running `iplw serve`, obtained by `acquire` and returned by `release`."""

    def __init__(self, binary: Path, collections: tuple[str, ...] = ()) -> None:
        self.binary = binary
        self.collections = collections
        self._command = [str(binary), *_ARGUMENTS, *(word for name in collections for word in ("--tasks", name))]
        self.users = 0
        self._lines: deque[str] = deque(maxlen=40)
        self._output_changed = threading.Condition()
        #: Scheme -> address.
        self._addresses: dict[str, str] = {}
        self._ended = False
        try:
            # A new session: Ctrl-C in the terminal must not reach the server.
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # A private server needs no tokens.
                env={name: value for name, value in os.environ.items() if name != "IPLW_TOKENS"},
            )
        except OSError as error:
            raise ServerUnavailable(f"cannot start {binary}: {error}; {INSTALL_HINT}") from error
        self._reader = threading.Thread(target=self._read, name="iplw-server-output", daemon=True)
        self._reader.start()
        #: HTTP address.
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
        """The address for `http` or `tcp`."""
        return self._addresses.get(scheme) or self._wait(scheme)

    def advice(self) -> str:
        """A hint for the message of a failed request; empty if the server is running."""
        if self.pid in _inherited_pids:
            return ""
        with suppress(subprocess.TimeoutExpired):
            # A connection breaks shortly before the process ends.
            code = self._process.wait(timeout=0.5)
            return (
                f"the private server has stopped (exit code {code}); make a new iplw.Client(){self._last_lines()}"
            )
        return ""

    def stop(self) -> None:
        """Stops the process and waits for it."""
        self.close_stdin()
        try:
            self._process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(STOP_TIMEOUT)
        if self._process.stdout is not None and not self._reader.is_alive():
            self._process.stdout.close()

    def close_stdin(self) -> None:
        """Closes the pipe that keeps the server alive."""
        if self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()

    def _read(self) -> None:
        # Read until the end, so that the server never blocks on a full pipe.
        assert self._process.stdout is not None
        for raw in self._process.stdout:
            line = raw.decode(errors="replace").rstrip()
            self._lines.append(line)
            if _LISTENING in line:
                address = line.partition(_LISTENING)[2].split()[0].rstrip("/")
                with self._output_changed:
                    self._addresses.setdefault(address.partition(":")[0], address)
                    self._output_changed.notify_all()
        with self._output_changed:
            self._ended = True
            self._output_changed.notify_all()

    def _wait(self, scheme: str) -> str:
        with self._output_changed:
            self._output_changed.wait_for(lambda: scheme in self._addresses or self._ended, START_TIMEOUT)
            if scheme in self._addresses:
                return self._addresses[scheme]
            ended = self._ended
        # It ended or hangs.
        self.stop()
        reason = (
            f"ended with code {self._process.returncode}" if ended else f"printed no address for {START_TIMEOUT:g} s"
        )
        raise ServerUnavailable(
            f"`{' '.join(self._command)}` {reason} instead of printing "
            f"`listening on {scheme}://...`; {INSTALL_HINT}{self._last_lines()}"
        )

    def _last_lines(self) -> str:
        lines = list(self._lines)[-5:]
        return "; its last output:\n  " + "\n  ".join(lines) if lines else ""


def acquire(
    binary: str | os.PathLike[str] | None = None, collections: tuple[str, ...] = ()
) -> PrivateServer:
    """The private server of this process for this binary with these collections of families; starts it if necessary."""
    path = find_binary(binary)
    with _lock:
        server = _servers.get((path, collections))
        if server is None or not server.running:
            server = _servers[path, collections] = PrivateServer(path, collections)
        server.users += 1
        return server


def release(server: PrivateServer) -> None:
    """Releases a server; it stops when the last user releases it."""
    with _lock:
        server.users -= 1
        if server.users > 0:
            return
        key = (server.binary, server.collections)
        if _servers.get(key) is server:
            del _servers[key]
    if server.pid not in _inherited_pids:
        server.stop()


_lock = threading.Lock()
#: Binary and collections -> server.
_servers: dict[tuple[Path, tuple[str, ...]], PrivateServer] = {}
#: Process ids of servers that belong to the parent of a fork.
_inherited_pids: set[int] = set()


def _stop_all() -> None:
    with _lock:
        servers = list(_servers.values())
        _servers.clear()
    for server in servers:
        server.stop()


def _after_fork() -> None:
    # Do not keep the pipe of the parent's server open, do not stop it; start a new server when needed.
    global _lock
    _lock = threading.Lock()
    for server in _servers.values():
        _inherited_pids.add(server.pid)
        server.close_stdin()
    _servers.clear()


atexit.register(_stop_all)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
