"""Authentication: tokens over both transports, from an argument or the environment."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import iplw
from iplw.binary import find_binary


class AuthenticatedServer:
    """A server that requires tokens."""

    def __init__(self, directory: Path) -> None:
        binary = str(find_binary())
        self.tokens = {
            scope: subprocess.run(
                [binary, "token", "new", scope, "--scope", scope, "--data-dir", str(directory)],
                check=True,
                capture_output=True,
                text=True,
            ).stdout.strip()
            for scope in ("read", "act")
        }
        arguments = ["serve", "--http", "127.0.0.1:0", "--zmq", "tcp://127.0.0.1:0", "--exit-with-stdin"]
        self.process = subprocess.Popen(
            [binary, *arguments, "--data-dir", str(directory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        lines = [self.process.stdout.readline() for _ in range(2)]
        self.http, self.tcp = (line.removeprefix("listening on ").strip() for line in lines)

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedServer]:
    server = AuthenticatedServer(tmp_path_factory.mktemp("guarded"))
    yield server
    server.close()


@pytest.mark.parametrize("transport", ["http", "tcp"])
def test_token_authenticates(guarded: AuthenticatedServer, transport: str) -> None:
    url = getattr(guarded, transport)
    for token in (None, "wrong"):
        with iplw.Client(url, token=token) as client, pytest.raises(iplw.Problem) as error:
            client.worlds()
        assert (error.value.status, error.value.slug) == (401, "unauthorized")
    with iplw.Client(url, token=guarded.tokens["read"]) as client:
        world = client.world("bowling-sim")
        with pytest.raises(iplw.Problem) as scope_error:
            world.reset()
        assert (scope_error.value.status, scope_error.value.slug) == (403, "forbidden")
    with iplw.Client(url, token=guarded.tokens["act"]) as client, client.create_world("bowling") as world:
        world.reset()


def test_url_and_token_from_environment(guarded: AuthenticatedServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IPLW_URL", guarded.http)
    monkeypatch.setenv("IPLW_TOKEN", guarded.tokens["act"])
    with iplw.Client() as client:
        assert client.url == guarded.http
        assert client.worlds()
    with iplw.Client("private") as client:
        assert client.server is not None
        assert client.worlds()


def test_private_server_needs_no_token(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    # Another binary starts a separate server.
    binary = Path(shutil.copy(find_binary(), tmp_path / "iplw"))
    monkeypatch.setenv("IPLW_TOKENS", "[]")
    with iplw.Client(binary=binary) as client:
        assert client.worlds()
