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
REPOSITORY = HERE.parents[1]
DOCUMENT = REPOSITORY / "openapi" / "openapi.json"
OUT = HERE / "out"


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    binary = os.environ.get("IPLW_BIN", str(REPOSITORY / "target" / "debug" / "iplw"))
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
        response = http.request(method, url + path, json=body) if body else http.request(method, url + path)
        return response.status, json.loads(response.data) if response.data else None

    families = [family["name"] for family in call("GET", "/v1/tasks")[1]["families"]]
    world = call("POST", "/v1/worlds", {"task": "bowling:002", "latents": {"friction": 0.5}})[1]
    address = f"/v1/worlds/{world['id']}"
    start = call("POST", f"{address}/reset", {"seed": 1})[1]
    results = call("POST", f"{address}/rollout", {"actions": [1000 * k for k in range(32)]})[1]["results"]
    selected = [result["valid"] for result in results].index(True)
    step = call("POST", f"{address}/step", {"action": 1000 * selected})[1]
    error_status, _ = call("POST", f"{address}/step", {"action": [0.5, 0.5, 0.2]})
    call("DELETE", address)
    deleted, _ = call("GET", address)
    return {
        "families": families,
        "task": start["info"]["task"],
        "first": start["observation"],
        "selected": selected,
        "observation": step["observation"],
        "reward": step["reward"],
        "terminated": step["terminated"],
        "steps": step["info"]["steps"],
        "error_status": error_status,
        "status_after_delete": deleted,
    }


def test_episode_is_valid(reference: dict[str, Any]) -> None:
    assert reference["terminated"] and reference["steps"] > 0
    assert (reference["error_status"], reference["status_after_delete"]) == (409, 404)


def test_python(url: str, reference: dict[str, Any]) -> None:
    target = OUT / "python"
    shutil.rmtree(target, ignore_errors=True)
    output = run(
        Path(sys.executable).parent / "openapi-python-client",
        *("generate", "--path", DOCUMENT, "--output-path", target / "iplw_generated", "--meta", "none"),
    )
    assert "ERROR" not in output, output
    assert json.loads(run(sys.executable, "episode.py", url, PYTHONPATH=str(target))) == reference


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

    Includes sequences of requests along the document's links. `EXAMPLES`: number of examples per operation, default 8.
    """
    print(
        run(
            Path(sys.executable).parent / "schemathesis",
            *("--config-file", HERE / "schemathesis.toml"),
            *("run", DOCUMENT, "--url", url),
            *("--max-examples", os.environ.get("EXAMPLES", "8")),
        )
    )
