"""A private server ends with its client, however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import iplw
from iplw import server


def has_ended(pid: int, within: float = 10.0) -> bool:
    """Whether the process ends within the time."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
            # A zombie has ended and waits to be reaped.
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.02)
    return False


def run(script: str, client: str = "iplw.Client()") -> subprocess.Popen[str]:
    """A Python subprocess with a client; prints the server's process id, then waits for a line of input."""
    head = f"import iplw, os, sys\nclient = {client}\nprint(client.server.pid, flush=True)\nsys.stdin.readline()\n"
    return subprocess.Popen(
        [sys.executable, "-c", head + script], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
    )


def server_of(child: subprocess.Popen[str]) -> int:
    assert child.stdout is not None
    pid = int(child.stdout.readline())
    os.kill(pid, 0)
    assert child.stdin is not None
    child.stdin.write("\n")
    child.stdin.flush()
    return pid


@pytest.mark.parametrize("how", ["iplw.AsyncClient()", "iplw.AsyncClient('tcp://private')"])
def test_server_ends_with_an_asynchronous_client_never_closed(how: str) -> None:
    child = run("import asyncio\nasync def use():\n    await client.worlds()\nasyncio.run(use())", how)
    pid = server_of(child)
    child.communicate()
    assert child.returncode == 0 and has_ended(pid)


@pytest.mark.parametrize(
    "end",
    [
        "client.close()\nos._exit(0)",
        "pass",
        "sys.stderr = open(os.devnull, 'w')\nraise RuntimeError('oops')",
        "sys.exit(3)",
        "os._exit(1)",
        "import gymnasium\nenv = gymnasium.make('iplw/Bowling-v0')\nenv.reset()",
        "os.abort()",
    ],
)
def test_server_ends_with_its_client(end: str) -> None:
    child = run(end)
    pid = server_of(child)
    child.communicate()
    assert has_ended(pid)


@pytest.mark.parametrize("client", ["iplw.Client()", "iplw.Client('tcp://private')"])
@pytest.mark.parametrize("fork", [False, True])
def test_server_ends_when_its_client_is_killed(fork: bool, client: str) -> None:
    # Even with a living forked child, which must not keep the server's pipe open.
    use = "world = client.create_world('bowling')\nworld.reset()\n"
    child = run(use + ("pid = os.fork()\n" if fork else "") + "sys.stdin.read()", client)
    pid = server_of(child)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert has_ended(pid)
    child.communicate()


def test_forked_child_leaves_server_of_parent() -> None:
    child = run(
        "pid = os.fork()\n"
        "if pid == 0:\n"
        "    client.worlds()\n"
        "    with iplw.Client() as own:\n"
        "        assert own.url != client.url\n"
        "    client.close()\n"
        "    sys.exit(0)\n"
        "assert os.waitpid(pid, 0)[1] == 0\n"
        "print(len(client.worlds()), flush=True)\n"
    )
    pid = server_of(child)
    out, _ = child.communicate()
    assert child.returncode == 0 and int(out) >= 4
    assert has_ended(pid)


def test_clients_share_one_server(client: iplw.Client) -> None:
    assert client.server is not None
    with iplw.Client() as other:
        assert other.url == client.url and other.server is client.server
    assert client.server.running, "only the last client stops it"


def test_server_ends_after_an_exception() -> None:
    child = run(
        "try:\n    with client:\n        raise KeyError\nexcept KeyError:\n    pass\n"
        "print('closed', flush=True)\nsys.stdin.read()"
    )
    pid = server_of(child)
    assert child.stdout is not None and child.stdout.readline() == "closed\n"
    assert has_ended(pid), "the client's process is still running"
    child.communicate()


def test_dead_server_is_reported_and_replaced() -> None:
    child = run(
        "os.kill(client.server.pid, 9)\n"
        "try:\n    client.create_world('bowling')\nexcept iplw.ServerUnavailable as error:\n print(error)\n"
        "with iplw.Client() as new:\n    print(len(new.worlds()))"
    )
    out, _ = child.communicate()
    message, worlds = out.splitlines()[1], out.splitlines()[-1]
    assert "private server has stopped (exit code -9); make a new iplw.Client()" in message
    assert int(worlds) >= 4


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("echo cannot bind; exit 3", ["ended with code 3", "cannot bind", "cargo build", "IPLW_BIN"]),
        ("sleep 60", ["printed no address for 0.3 s", "IPLW_BIN"]),
    ],
)
def test_server_start_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, words: list[str]
) -> None:
    monkeypatch.setattr(server, "START_TIMEOUT", 0.3 if "sleep" in body else 20.0)
    monkeypatch.setattr(server, "STOP_TIMEOUT", 0.1)
    binary = tmp_path / "iplw"
    binary.write_text(f"#!/bin/sh\n{body}\n")
    binary.chmod(0o755)
    with pytest.raises(iplw.ServerUnavailable) as caught:
        iplw.Client(binary=binary)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_missing_binary(tmp_path: Path) -> None:
    with pytest.raises(iplw.ServerUnavailable, match=r"binary is .*missing.*not an executable file"):
        iplw.Client(binary=tmp_path / "missing")
