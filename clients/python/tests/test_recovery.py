"""A server killed during an episode: a clear error, and recovery after a restart."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

import iplw
from iplw.binary import find_binary


def ports() -> tuple[int, int]:
    with socket.socket() as a, socket.socket() as b:
        a.bind(("127.0.0.1", 0))
        b.bind(("127.0.0.1", 0))
        return a.getsockname()[1], b.getsockname()[1]


class Server:
    """A server with fixed ports and a data directory that can be killed and restarted."""

    def __init__(self, data: Path, *extra: str) -> None:
        self.http, self.zmq = ports()
        self._command = [
            *(str(find_binary()), "serve", "--http", f"127.0.0.1:{self.http}"),
            *("--zmq", f"tcp://127.0.0.1:{self.zmq}", "--data-dir", str(data), "--exit-with-stdin", *extra),
        ]
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        lines = [self.process.stdout.readline(), self.process.stdout.readline()]
        assert all("listening on" in line for line in lines), lines

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def url(self, scheme: str) -> str:
        return f"http://127.0.0.1:{self.http}" if scheme == "http" else f"tcp://127.0.0.1:{self.zmq}"


@pytest.mark.parametrize("scheme", ["http", "tcp"])
def test_server_killed_during_episode(tmp_path: Path, scheme: str) -> None:
    server = Server(tmp_path)
    try:
        with iplw.Client(server.url(scheme), timeout=10) as client:
            world = client.create_world("bowling", kind="real")
            world.reset(seed=1)
            assert world.step(20_000)[4]["task"]
            spent = world.interactions
            job = client.iplw("bowling", real={"damping": 0.8}, rounds=10, actions=50, samples=1000)
            server.kill()
            for ask in (lambda: world.step(20_000), client.worlds, lambda: job.wait(timeout=8)):
                start = time.monotonic()
                with pytest.raises(iplw.ServerUnavailable) as caught:
                    ask()
                assert time.monotonic() - start < 10
                words = str(caught.value)
                assert server.url(scheme) in words and ("iplw serve" in words or "still runs" in words), words
            server.start()
            # The same objects: the world exists with its interactions and waits for a reset.
            assert world.interactions == spent
            with pytest.raises(iplw.Problem) as rejected:
                world.step(20_000)
            assert rejected.value.status == 409
            world.reset(seed=1)
            world.step(20_000)
            assert job.refresh().state in ("queued", "running")
            job.cancel()
    finally:
        server.kill()


@pytest.mark.parametrize("scheme", ["http", "tcp"])
def test_server_killed_during_request(tmp_path: Path, scheme: str) -> None:
    server = Server(tmp_path)
    killer = None
    try:
        with iplw.Client(server.url(scheme), timeout=20) as client:
            world = client.create_world("bowling", engine="rapier")
            killer = subprocess.Popen(["sh", "-c", f"sleep 0.5; kill -9 {server.process.pid}"])
            start = time.monotonic()
            with pytest.raises(iplw.ServerUnavailable, match="broke during .*may or may not have been executed"):
                world.rollout(range(4096), task="bowling:002", batch=4096, stop=False)
            assert time.monotonic() - start < 20
    finally:
        if killer is not None:
            killer.wait()
        server.kill()


@pytest.mark.parametrize("scheme", ["http", "tcp"])
def test_async_client_recovers(tmp_path: Path, scheme: str) -> None:
    server = Server(tmp_path)

    async def run() -> None:
        async with iplw.AsyncClient(server.url(scheme), timeout=10) as client:
            world = await client.create_world("bowling")
            await world.reset(seed=1)
            server.kill()
            with pytest.raises(iplw.ServerUnavailable):
                await world.step(20_000)
            server.start()
            await world.reset(seed=1)
            assert (await world.step(20_000))[4]["task"]

    try:
        asyncio.run(run())
    finally:
        server.kill()


def test_idle_worlds_of_killed_client_are_deleted(tmp_path: Path) -> None:
    server = Server(tmp_path, "--idle", "1")
    code = (
        "import iplw, sys\nfor url in sys.argv[1:]:\n    client = iplw.Client(url)\n"
        "    client.create_world('bowling').reset()\n    iplw.make_vec('bowling', 3, url=url).reset()\n"
        "print('made', flush=True)\nsys.stdin.read()\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, server.url("http"), server.url("tcp")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert child.stdout is not None and child.stdout.readline() == "made\n"
        with iplw.Client(server.url("http")) as client:
            assert len(client.worlds()) == 4 + 2 * 4
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
            until = time.monotonic() + 15
            while len(client.worlds()) > 4 and time.monotonic() < until:
                time.sleep(0.2)
            assert len(client.worlds()) == 4
    finally:
        child.kill()
        child.communicate()
        server.kill()
