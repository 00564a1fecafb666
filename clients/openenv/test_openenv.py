"""Tests with OpenEnv's client and tools from PyPI, in a separate environment: `make test-openenv`."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import requests
import uvicorn
import yaml
from openenv.cli._validation import validate_running_environment
from openenv.core import GenericEnvClient
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import iplw
from iplw.openenv import Budget, IplwAction, IplwEnv, IplwEnvironment, Settings, make_app, settings

#: A valid and an overlapping placement of bowling's red ball.
FINE, NO_ROOM = [0.5, 0.9, 0.3], [0.0, 0.0, 0.0]

#: Fields that OpenEnv sends in addition to an observation.
BESIDE = {"reward", "done", "metadata"}


@contextlib.contextmanager
def serving(client: iplw.Client, values: Settings) -> Iterator[str]:
    """Serves the application of `python -m iplw.openenv` in a thread."""
    listener = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(make_app(values, client), log_level="warning"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(20)


@pytest.fixture(scope="module")
def client() -> Iterator[iplw.Client]:
    with iplw.Client() as created:
        yield created


@pytest.fixture(scope="module")
def sim(client: iplw.Client) -> Iterator[str]:
    with serving(client, Settings(sessions=8, show=("scene", "picture"))) as url:
        yield url


@pytest.fixture(scope="module")
def real(client: iplw.Client) -> Iterator[str]:
    with serving(client, Settings(world="real", budget=4)) as url:
        yield url


def eventually(holds: Callable[[], bool], seconds: float = 60.0) -> bool:
    until = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


def test_episode_matches_iplw_client(sim: str, client: iplw.Client) -> None:
    with GenericEnvClient(base_url=sim).sync() as env, client.create_world("bowling") as world:
        start = env.reset(seed=1, episode_id="first")
        features, info = world.reset(seed=1, split="train")
        assert start.observation["features"] == features.tolist()
        assert (start.observation["task"], start.reward, start.done) == (info["task"], None, False)
        assert start.observation["scene"]["format"] == "iplw.scene/1"
        png = base64.b64decode(start.observation["picture"])
        assert png.startswith(b"\x89PNG")
        rejected = env.step({"action": NO_ROOM})
        assert (rejected.observation["valid"], rejected.done) == (False, False)
        assert rejected.observation["reason"] == "red leaves the scene"
        assert base64.b64decode(rejected.observation["picture"]) == png
        created = env.step({"action": FINE})
        features, reward, terminated, _, info = world.step(FINE)
        assert created.observation["features"] == features.tolist()
        assert (created.reward, created.done, created.observation["valid"]) == (reward, terminated, True)
        assert {key: created.observation[key] for key in ("steps", "solved", "end")} == {
            key: info[key] for key in ("steps", "solved", "end")
        }
        assert base64.b64decode(created.observation["picture"]) != png, "the placed body is drawn"
        state = env.state()
        assert (state["episode_id"], state["step_count"], state["done"]) == ("first", 2, True)
        assert state["latents"] == world.latents
        again = env.reset(task="bowling:003", latents={"friction": 0.4})
        assert again.observation["task"] == "bowling:003"
        assert env.state()["latents"]["friction"] == 0.4


def test_typed_client_solves_task(sim: str, client: iplw.Client) -> None:
    attempted = np.random.default_rng(0).random((500, 3))
    with client.create_world("bowling:001") as world:
        solution = attempted[world.rollout(attempted, task="bowling:001").solved][0].tolist()

    async def episode() -> None:
        async with IplwEnv(base_url=sim) as env:
            await env.reset(task="bowling:001")
            result = await env.step(IplwAction(action=solution))
            assert (result.observation.solved, result.reward, result.done) == (True, 1.0, True)
            assert result.observation.end == "goal" and (await env.state()).task == "bowling:001"
            start = await env.reset(seed=5)
            by_index = await env.step(IplwAction(action=17))
            await env.reset(seed=5)
            as_text = await env._send_and_receive({"type": "step", "data": {"action": "17"}})
            counted = by_index.observation.interactions + bool(by_index.observation.valid)
            response = {**by_index.observation.model_dump(exclude=BESIDE), "interactions": counted}
            assert as_text["data"]["observation"] == response, "text is parsed as JSON"
            assert start.observation.valid is None and isinstance(by_index.observation.valid, bool)

    asyncio.run(episode())


def test_budget_over_all_sessions(real: str) -> None:
    with GenericEnvClient(base_url=real).sync() as env:
        assert env.reset(seed=1).observation["remaining"] == 4
        assert env.state()["latents"] is None
        assert env.step({"action": NO_ROOM}).observation["remaining"] == 4, "an invalid action is no attempt"
        for bad in ([0.5, 0.9], [0.5, 0.9, 2.0], [float("nan")] * 3):
            with pytest.raises(RuntimeError, match="allowed"):
                env.step({"action": bad})
        created = env.step({"action": FINE})
        assert (created.observation["interactions"], created.observation["remaining"]) == (1, 3)
        with pytest.raises(RuntimeError, match="the episode has ended; reset"):
            env.step({"action": FINE})
        with pytest.raises(RuntimeError, match="sealed|hidden"):
            env.reset(latents={"friction": 0.1})
        assert env.reset(seed=2).observation["remaining"] == 3
    # Concurrent sessions share the remaining budget.
    outcomes: list[str] = []

    def attempt(seed: int) -> None:
        with GenericEnvClient(base_url=real).sync() as env:
            env.reset(seed=seed)
            try:
                outcomes.append("made" if env.step({"action": FINE}).observation["valid"] else "invalid")
            except RuntimeError as error:
                outcomes.append(str(error))

    threads = [threading.Thread(target=attempt, args=(1,)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert outcomes.count("made") == 3, outcomes
    assert sum("the budget of 4 real interactions" in output for output in outcomes) == 5


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ({"action": [0.5, 0.9]}, "`action` is 2 numbers; allowed: 3 numbers in [0, 1]"),
        ({"action": [0.5, 0.9, 2]}, "`action[2]` is 2; allowed: a number from 0 to 1"),
        ({"action": [float("nan")] * 3}, "allowed: finite numbers from 0 to 1"),
        ({"action": 99999999}, "`action` is 99999999; allowed: an index from 0 to 49999"),
        ({"action": "left"}, "`action` is 'left'; allowed: an index, or a list of numbers"),
        ({}, "`action` is missing; allowed: an index, or a list"),
        ({"vector": FINE}, "`vector`: Extra inputs are not permitted; allowed: action, metadata"),
    ],
)
def test_rejects_invalid_actions(sim: str, message: dict[str, Any], expected: str) -> None:
    with GenericEnvClient(base_url=sim).sync() as env:
        env.reset(seed=1)
        with pytest.raises(RuntimeError, match=re.escape(expected)):
            env.step(message)
        assert env.step({"action": FINE}).done, "the session continues"


def test_rejects_invalid_resets(sim: str) -> None:
    with GenericEnvClient(base_url=sim).sync() as env:
        with pytest.raises(RuntimeError, match="no episode has started; call reset first"):
            env.step({"action": FINE})
        for values, expected in (
            ({"tsak": 1}, "reset does not accept ['tsak']; allowed: seed, episode_id, task, split, latents"),
            ({"task": "bowling:999"}, "no task named `bowling:999`; known: bowling:000 to bowling:099"),
            ({"split": "exam"}, "expected one of `train`, `validation`, `test`"),
            ({"seed": -1}, "`seed`; allowed"),
            ({"latents": {"friction": -1}}, "`friction` is -1; allowed"),
        ):
            with pytest.raises(RuntimeError, match=re.escape(expected)):
                env.reset(**values)


def test_sessions_create_and_delete_worlds(sim: str, client: iplw.Client) -> None:
    def worlds() -> set[str]:
        return {world.id for world in client.worlds()}

    before = worlds()
    with contextlib.ExitStack() as stack:
        envs = [stack.enter_context(GenericEnvClient(base_url=sim).sync()) for _ in range(8)]
        sampled = {tuple(env.reset().observation["task"] for _ in range(3)) for env in envs}
        assert len(worlds() - before) == 8
        assert len(sampled) > 1, "sessions without seeds get different tasks"
        # (The client may see the closed connection before the reason.)
        with connect(sim.replace("http", "ws") + "/ws") as ninth:
            assert json.loads(ninth.recv(60))["data"]["code"] == "CAPACITY_REACHED"
        envs[0].reset(seed=1)
        assert envs[0].step({"action": FINE}).done and not envs[1].state()["done"]
    assert eventually(lambda: worlds() <= before), "a session deletes its world when it ends"
    # So does a session whose client dies.
    script = f"""
from openenv.core.sync_client import SyncEnvClient
from openenv.core.generic_client import GenericEnvClient
import time
env = GenericEnvClient(base_url={sim!r}).sync()
env.reset(seed=1)
print("begun", flush=True)
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as dying:
        assert dying.stdout is not None and dying.stdout.readline() == "begun\n"
        assert len(worlds() - before) == 1
        dying.send_signal(signal.SIGKILL)
    assert eventually(lambda: worlds() <= before)


def test_expired_session_creates_no_world(client: iplw.Client) -> None:
    session = IplwEnvironment(client, Settings(), Budget())
    session.reset(seed=1)
    session.close()
    session.close()
    with pytest.raises(RuntimeError, match="was deleted because the session was idle; connect again"):
        session.reset(seed=1)


def test_http_requests_are_independent(sim: str, client: iplw.Client) -> None:
    before = len(client.worlds())
    created = requests.post(f"{sim}/reset", json={"seed": 1}, timeout=60).json()
    assert created["observation"]["task"].startswith("bowling:")
    for path, body, status, expected in (
        ("reset", {"tsak": 1}, 422, "reset does not accept ['tsak']"),
        ("reset", {"task": "bowling:999"}, 404, "no task named `bowling:999`"),
        ("step", {"action": {"action": FINE}}, 409, "HTTP requests do not share a session"),
        ("step", {"action": {"acton": FINE}}, 422, "`acton`"),
    ):
        answer = requests.post(f"{sim}/{path}", json=body, timeout=60)
        assert answer.status_code == status and expected in answer.json()["detail"]
    assert len(client.worlds()) == before


def test_openenv_validation(sim: str) -> None:
    report = validate_running_environment(sim)
    assert report["passed"], report
    schema = requests.get(f"{sim}/schema", timeout=60).json()
    assert schema["action"]["required"] == ["action"]
    assert {"features", "valid", "solved", "interactions"} <= set(schema["observation"]["properties"])
    assert requests.get(f"{sim}/metadata", timeout=60).json()["version"] == iplw.__version__


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Host": "rebound.example"}, 403),
        ({"Host": "localhost:1"}, 200),
    ],
)
def test_rejects_other_origins(sim: str, headers: dict[str, str], status: int) -> None:
    assert requests.get(f"{sim}/health", headers=headers, timeout=60).status_code == status
    if "Origin" in headers:
        with pytest.raises(InvalidStatus, match="403"):
            connect(sim.replace("http", "ws") + "/ws", additional_headers=headers)
    local_value = requests.get(f"{sim}/health", headers={"Origin": sim}, timeout=60)
    assert local_value.status_code == 200


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--task", "bwling"], "no task family named `bwling`"),
        (["--world", "rel"], "world is 'rel'; allowed: 'sim', 'real'"),
        (["--world", '{"kind": "real", "dampin": 1}'], "world has ['dampin']"),
        (["--sessions", "0"], "sessions is 0; allowed: 1 or more"),
        (["--budget", "-1"], "budget is -1"),
        (["--scene", "nowhere.json"], "nowhere.json"),
        (["--world", "{"], "--world"),
    ],
)
def test_command_rejects_invalid_settings(
    arguments: list[str], expected: str, client: iplw.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    from iplw.openenv.__main__ import main

    code: Any = None
    try:
        code = main([*arguments, "--port", "0"])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert expected in capsys.readouterr().err


def test_command_serves_custom_scene(tmp_path: Path, client: iplw.Client) -> None:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(client.task("bowling:001")["scene"]))
    command = [sys.executable, "-m", "iplw.openenv", "--scene", str(file), "--world", "real", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None and server.stderr is not None
            output = server.stdout.readline()
            with GenericEnvClient(base_url=output.split()[-1]).sync() as env:
                assert env.reset().observation["task"].startswith("custom:")
                assert np.isfinite(env.step({"action": FINE}).observation["features"]).all()
        finally:
            server.send_signal(signal.SIGTERM)
        assert server.stderr.read() == ""
    assert server.returncode in (0, -signal.SIGTERM)


def test_documentation_examples_run(client: iplw.Client, capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "openenv.md").read_text()
    plain, typed = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    with serving(client, Settings()) as url:
        exec(plain.replace("http://127.0.0.1:8000", url), {})
        body = "".join(f"    {line}\n" for line in typed.replace("http://127.0.0.1:8000", url).splitlines())
        names: dict[str, Any] = {}
        exec(f"async def example():\n{body}", names)
        asyncio.run(names["example"]())
    assert "bowling:" in capsys.readouterr().out


def test_manifest() -> None:
    import iplw.openenv

    assert iplw.openenv.__file__ is not None
    manifest = yaml.safe_load((Path(iplw.openenv.__file__).parent / "openenv.yaml").read_text())
    assert (manifest["spec_version"], manifest["name"], manifest["runtime"]) == (1, "iplw", "fastapi")
    os.environ["IPLW_OPENENV"] = "--task bowling:003 --sessions 2"
    try:
        module, _, name = manifest["app"].partition(":")
        assert callable(getattr(__import__(module, fromlist=[name]), name))
    finally:
        del os.environ["IPLW_OPENENV"]
    for name in (manifest["action"], manifest["observation"]):
        assert hasattr(iplw.openenv, name)
    assert settings.parser().parse_args([]).port == manifest["port"]
