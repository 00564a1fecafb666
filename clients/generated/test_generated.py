"""Clients generated from the OpenAPI document, each for one episode; and conformance of the server to the document.

`IPLW_BIN` is the server executable. The TypeScript client requires node and `npm ci`.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import urllib3

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]
DOCUMENT = CHECKOUT / "openapi" / "openapi.json"
OUT = HERE / "out"


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    binary = os.environ.get("IPLW_BIN", str(CHECKOUT / "target" / "debug" / "iplw"))
    server = subprocess.Popen(
        [binary, "serve", "--http", "127.0.0.1:0", "--exit-with-stdin"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert server.stdout is not None and server.stdin is not None
    line = server.stdout.readline()
    yield line.partition("listening on ")[2].strip()
    server.stdin.close()
    assert server.wait(10) == 0, "the server exits without error"


def run(*command: str | Path, **environment: str) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        cwd=HERE,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def reference(url: str) -> dict[str, Any]:
    """The episode with plain HTTP and JSON."""
    http = urllib3.PoolManager()

    def call(method: str, path: str, body: Any = None) -> tuple[int, Any]:
        answer = http.request(method, url + path, json=body) if body else http.request(method, url + path)
        return answer.status, json.loads(answer.data) if answer.data else None

    families = [family["name"] for family in call("GET", "/v1/tasks")[1]["families"]]
    world = call("POST", "/v1/worlds", {"task": "bowling:002", "latents": {"friction": 0.5}})[1]
    at = f"/v1/worlds/{world['id']}"
    start = call("POST", f"{at}/reset", {"seed": 1})[1]
    results = call("POST", f"{at}/rollout", {"actions": [1000 * k for k in range(32)]})[1]["results"]
    selected = [result["valid"] for result in results].index(True)
    step = call("POST", f"{at}/step", {"action": 1000 * selected})[1]
    rejected, _ = call("POST", f"{at}/step", {"action": [0.5, 0.5, 0.2]})
    call("DELETE", at)
    has_ended, _ = call("GET", at)
    return {
        "families": families,
        "task": start["info"]["task"],
        "first": start["observation"],
        "chosen": selected,
        "observation": step["observation"],
        "reward": step["reward"],
        "terminated": step["terminated"],
        "steps": step["info"]["steps"],
        "refused": rejected,
        "gone": has_ended,
    }


def test_episode_is_valid(reference: dict[str, Any]) -> None:
    assert reference["terminated"] and reference["steps"] > 0
    assert (reference["refused"], reference["gone"]) == (409, 404)


def test_python(url: str, reference: dict[str, Any]) -> None:
    created = OUT / "python"
    shutil.rmtree(created, ignore_errors=True)
    message = run(
        Path(sys.executable).parent / "openapi-python-client",
        *("generate", "--path", DOCUMENT, "--output-path", created / "iplw_generated", "--meta", "none"),
    )
    assert "ERROR" not in message, message
    assert json.loads(run(sys.executable, "episode.py", url, PYTHONPATH=str(created))) == reference


@pytest.mark.skipif(shutil.which("node") is None, reason="no node")
def test_typescript(url: str, reference: dict[str, Any]) -> None:
    tools = HERE / "node_modules" / ".bin"
    if not (tools / "tsc").exists():
        pytest.fail("no node_modules; run `npm ci` in clients/generated, or `make test-clients`")
    run(tools / "openapi-typescript", DOCUMENT, "--output", OUT / "schema.ts")
    run(tools / "tsc", "--project", ".")
    assert json.loads(run("node", OUT / "js" / "episode.js", url)) == reference


def test_server_conforms_to_document(url: str) -> None:
    """All of schemathesis's checks: status codes, content types, schemas, headers, rejection of invalid input.

    Also of requests that follow from each other, by the document's links. `EXAMPLES` of each operation, 8 by default.
    """
    print(
        run(
            Path(sys.executable).parent / "schemathesis",
            *("--config-file", HERE / "schemathesis.toml"),
            *("run", DOCUMENT, "--url", url),
            *("--max-examples", os.environ.get("EXAMPLES", "8")),
        )
    )
