"""Clients made from the OpenAPI document, each through a whole episode; and the document held to by the server.

`IPLW_BIN` names the server. The TypeScript client needs node and `npm ci`.
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
    assert server.wait(10) == 0, "the server is well to the end"


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
def by_hand(url: str) -> dict[str, Any]:
    """The episode with nothing but HTTP and JSON."""
    http = urllib3.PoolManager()

    def call(method: str, path: str, body: Any = None) -> tuple[int, Any]:
        answer = http.request(method, url + path, json=body) if body else http.request(method, url + path)
        return answer.status, json.loads(answer.data) if answer.data else None

    families = [family["name"] for family in call("GET", "/v1/tasks")[1]["families"]]
    world = call("POST", "/v1/worlds", {"task": "bowling:002", "latents": {"friction": 0.5}})[1]
    at = f"/v1/worlds/{world['id']}"
    start = call("POST", f"{at}/reset", {"seed": 1})[1]
    results = call("POST", f"{at}/rollout", {"actions": [1000 * k for k in range(32)]})[1]["results"]
    chosen = [result["valid"] for result in results].index(True)
    step = call("POST", f"{at}/step", {"action": 1000 * chosen})[1]
    refused, _ = call("POST", f"{at}/step", {"action": [0.5, 0.5, 0.2]})
    call("DELETE", at)
    gone, _ = call("GET", at)
    return {
        "families": families,
        "task": start["info"]["task"],
        "first": start["observation"],
        "chosen": chosen,
        "observation": step["observation"],
        "reward": step["reward"],
        "terminated": step["terminated"],
        "steps": step["info"]["steps"],
        "refused": refused,
        "gone": gone,
    }


def test_the_episode_is_one(by_hand: dict[str, Any]) -> None:
    assert by_hand["terminated"] and by_hand["steps"] > 0
    assert (by_hand["refused"], by_hand["gone"]) == (409, 404)


def test_python(url: str, by_hand: dict[str, Any]) -> None:
    made = OUT / "python"
    shutil.rmtree(made, ignore_errors=True)
    said = run(
        Path(sys.executable).parent / "openapi-python-client",
        *("generate", "--path", DOCUMENT, "--output-path", made / "iplw_generated", "--meta", "none"),
    )
    assert "ERROR" not in said, said
    assert json.loads(run(sys.executable, "episode.py", url, PYTHONPATH=str(made))) == by_hand


@pytest.mark.skipif(shutil.which("node") is None, reason="no node")
def test_typescript(url: str, by_hand: dict[str, Any]) -> None:
    tools = HERE / "node_modules" / ".bin"
    if not (tools / "tsc").exists():
        pytest.fail("no node_modules; run `npm ci` in clients/generated, or `make test-clients`")
    run(tools / "openapi-typescript", DOCUMENT, "--output", OUT / "schema.ts")
    run(tools / "tsc", "--project", ".")
    assert json.loads(run("node", OUT / "js" / "episode.js", url)) == by_hand


def test_the_server_does_what_the_document_says(url: str) -> None:
    """All of schemathesis's checks: status codes, content types, schemas, headers, refusals of what is not allowed.

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
