"""`iplw mcp` with the reference client: an episode, errors, cancellation, shutdown."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import subprocess
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from iplw.binary import find_binary

pytest.importorskip("mcp")

import mcp_types as types
from mcp import Client, MCPError, StdioServerParameters
from mcp.client.stdio import stdio_client

TASK = "bowling:017"
TOOLS = ["list_tasks", "look", "propose_actions", "roll_out", "measure", "estimate", "diagnose"]


@asynccontextmanager
async def agent(
    *arguments: str, mode: str = "auto", log: Path | None = None, token: str | None = None
) -> AsyncIterator[Client]:
    """A client with an `iplw mcp` subprocess."""
    environment = {"RUST_LOG": "warn"} | ({} if token is None else {"IPLW_TOKEN": token})
    command = ["mcp", "--log", "json", *arguments]
    server = StdioServerParameters(command=str(find_binary()), args=command, env=environment)
    with open(log or os.devnull, "a", encoding="utf-8") as errors:
        async with Client(stdio_client(server, errlog=errors), mode=mode) as client:
            yield client


def run(conversation: Callable[[], Awaitable[None]], seconds: float = 120.0) -> None:
    """Runs a conversation with a time limit."""

    async def within() -> None:
        await asyncio.wait_for(conversation(), seconds)

    asyncio.run(within())


async def call(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    """The structured result of a tool, which the client validates with the output schema."""
    result = await client.call_tool(tool, arguments)
    assert not result.is_error, words(result)
    response = result.structured_content
    assert isinstance(response, dict)
    texts = [block.text for block in result.content if isinstance(block, types.TextContent)]
    # The text contains the complete result.
    assert len(texts) == 2 and texts[0] and json.loads(texts[1]) == response
    return response


async def refusal(client: Client, tool: str, **arguments: Any) -> str:
    """The error message of a tool."""
    result = await client.call_tool(tool, arguments)
    assert result.is_error, result
    return words(result)


def words(result: types.CallToolResult) -> str:
    """The first text content."""
    first = result.content[0]
    assert isinstance(first, types.TextContent)
    return first.text


def pictures(result: types.CallToolResult) -> list[bytes]:
    """The PNG images."""
    images = [block for block in result.content if isinstance(block, types.ImageContent)]
    assert all(image.mime_type == "image/png" for image in images)
    return [base64.b64decode(image.data) for image in images]


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_lists_tools_and_resources(mode: str) -> None:
    async def conversation() -> None:
        async with agent(mode=mode) as client:
            tools = (await client.list_tools()).tools
            assert [tool.name for tool in tools] == TOOLS
            for tool in tools:
                assert tool.annotations is not None and tool.output_schema is not None and tool.description
                hints = tool.annotations
                assert hints.destructive_hint is False and hints.open_world_hint is False
                assert hints.idempotent_hint is (tool.name not in ("measure", "estimate"))
                assert hints.read_only_hint is (tool.name in ("list_tasks", "look", "roll_out"))
            pages = (await client.list_resources()).resources
            assert all(page.mime_type in ("text/markdown", "application/json") for page in pages)
            texts = {}
            for page in pages:
                (content,) = (await client.read_resource(page.uri)).contents
                assert isinstance(content, types.TextResourceContents)
                texts[str(page.uri)] = content.text
            assert "iplw.scene/1" in texts["iplw://docs/formats"]
            assert "linear_drag" in [effect["name"] for effect in json.loads(texts["iplw://effects"])]
            with pytest.raises(MCPError, match="available: iplw://docs/agents"):
                await client.read_resource("iplw://nowhere")
            assert [prompt.name for prompt in (await client.list_prompts()).prompts] == ["calibrate", "what_is_wrong"]
            (message,) = (await client.get_prompt("calibrate", {"task": TASK})).messages
            assert isinstance(message.content, types.TextContent) and TASK in message.content.text
            assert client.instructions and "real world" in client.instructions

    run(conversation)


def test_episode() -> None:
    """Look, roll out, propose, measure, estimate, and measure until the budget is spent."""

    async def conversation() -> None:
        async with agent("--real-interactions", "4") as client:
            families = await call(client, "list_tasks")
            assert {"bowling", "basketball"} <= {row["name"] for row in families["families"]}
            listed = await call(client, "list_tasks", family="bowling", limit=3)
            assert len(listed["tasks"]) == 3 and listed["next"]
            assert "action" not in listed["tasks"][0], "solutions are not disclosed"

            observed = await client.call_tool("look", {"task": TASK})
            (picture,) = pictures(observed)
            assert picture.startswith(b"\x89PNG") and "green" in words(observed)
            response = await call(client, "look", task=TASK)
            assert response["budget"] == {"limit": 4, "spent": 0, "remaining": 4}

            rng = np.random.default_rng(1)
            actions = rng.random((32, 3)).round(3).tolist()
            rollouts = await call(client, "roll_out", task=TASK, actions=actions, latents={"restitution": 0.4})
            assert [row["action"] for row in rollouts["results"]] == actions
            placed = [row["action"] for row in rollouts["results"] if row["reason"] is None]
            assert placed and len(rollouts["paths"]["red"]) == 13
            assert rollouts == await call(client, "roll_out", task=TASK, actions=actions, latents={"restitution": 0.4})

            first = await call(client, "propose_actions", task=TASK, actions=2)
            assert len(first["proposals"]) == 2 and first["known"] == [] and first["expected"]
            assert first == await call(client, "propose_actions", task=TASK), "the request is idempotent"
            for rest_left, proposal in zip([1, 0], first["proposals"], strict=True):
                measured = await call(client, "measure", task=TASK, proposal=proposal["number"])
                assert measured["action"] == proposal["action"] and measured["open"] == rest_left
            assert measured["budget"] == {"limit": 4, "spent": 2, "remaining": 2}
            assert "number of an open proposal" in await refusal(client, "measure", task=TASK, proposal=0)
            second = await call(client, "propose_actions", task=TASK)
            assert second["round"] == 1 and second["proposals"]
            assert {row["name"] for row in second["known"]} == {"density", "friction", "restitution"}

            film = await client.call_tool("measure", {"task": TASK, "action": placed[0]})
            assert not film.is_error and pictures(film)[0].startswith(b"\x89PNG")
            last = await call(client, "measure", task=TASK, proposal=second["proposals"][0]["number"])
            assert last["budget"]["remaining"] == 0
            rejected = await refusal(client, "measure", task=TASK, action=placed[0])
            assert "budget" in rejected.lower() and "roll_out" in rejected
            assert "budget" in (await refusal(client, "estimate", task=TASK)).lower()
            # One of two proposals was measured: it is fitted, and no more are proposed.
            ended = await call(client, "propose_actions", task=TASK)
            assert ended["proposals"] == [] and "budget" in ended["ended"] and ended["known"] != second["known"]
            # Another family has its own real world.
            other = await call(client, "look", task="basketball:003")
            assert other["budget"]["remaining"] == 4

    run(conversation)


def test_estimate_reports_progress() -> None:
    async def conversation() -> None:
        text_out: list[tuple[float, str | None]] = []

        async def hear(progress: float, total: float | None, message: str | None) -> None:
            text_out.append((progress, message))

        async with agent() as client:
            requested = {"task": "bowling", "rounds": 1, "actions": 3, "strategy": "mixed"}
            found = await client.call_tool("estimate", requested, progress_callback=hear)
            assert not found.is_error, words(found)
            response = found.structured_content
            assert response["real_interactions"] == 3 and response["budget"]["spent"] == 3
            assert [row["name"] for row in response["latents"]] == ["density", "friction", "restitution"]
            assert text_out and sorted(text_out) == text_out and all(message for _, message in text_out)

    run(conversation)


def test_diagnoses_trials_as_text() -> None:
    """Throws with air drag, simulated without it."""
    tracks = {f"throw{i}": throw(3.0 + 0.7 * i, 0.3 + 0.1 * (i % 4), i) for i in range(6)}

    async def conversation() -> None:
        async with agent() as client:
            ball = {"radius": 0.02, "mass": 0.0027}
            found = await call(client, "diagnose", trials=tracks, ball=ball)
            assert found["verdict"] in ("named", "ambiguous"), found["reason"]
            assert any("drag" in name or name == "moving_air" for names in found["rivals"] for name in names)
            rollouts = await call(client, "roll_out", scene=found["extended_scene"])
            assert rollouts["results"][0]["seconds"] > 0.0 and rollouts["paths"]
            few = await call(client, "diagnose", trials=tracks["throw0"], ball=ball)
            assert few["verdict"] == "insufficient_data"

    run(conversation)


def throw(speed: float, angle: float, seed: int) -> str:
    """CSV of t (s), x and y (m): quadratic drag 0.15 per m, 0.2 mm of noise, 60 frames in 0.6 s."""
    state = np.array([0.0, 1.0, speed * np.cos(angle), speed * np.sin(angle)])
    rng = np.random.default_rng(seed)

    def change(s: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        fast = 0.15 * np.hypot(s[2], s[3])
        return np.array([s[2], s[3], -fast * s[2], -9.81 - fast * s[3]])

    rows = ["t,x,y"]
    for k in range(60):
        x, y = state[:2] + rng.normal(0.0, 2e-4, 2)
        rows.append(f"{k * 0.01:.2f},{x:.6f},{y:.6f}")
        for _ in range(10):
            state = state + 0.001 * change(state + 0.0005 * change(state))
    return "\n".join(rows) + "\n"


def bad() -> Iterator[tuple[str, dict[str, Any], str]]:
    """A tool, invalid arguments, and a word of the error message."""
    yield "list_tasks", {"family": "curling"}, "curling"
    yield "list_tasks", {"limit": 0}, "`limit`"
    yield "list_tasks", {"famly": "bowling"}, "famly"
    yield "look", {}, "task"
    yield "look", {"task": "bowling:999"}, "bowling:000 to"
    yield "look", {"task": "bowling"}, "bowling:000 to"
    yield "look", {"task": TASK, "action": [0.5]}, "3 numbers"
    yield "look", {"task": TASK, "action": [0.5, 0.5, 1.5]}, "1.5"
    yield "look", {"task": TASK, "action": "left"}, "action"
    yield "roll_out", {"actions": [[0.5, 0.5, 0.5]]}, "one of task and scene"
    yield "roll_out", {"task": TASK, "actions": []}, "1 to 32"
    yield "roll_out", {"task": TASK, "actions": [[0.5, 0.5, 0.5]] * 33}, "1 to 32"
    yield "roll_out", {"task": TASK, "actions": [[0.5, 0.5, 0.5], [2, 0, 0]]}, "actions[1]"
    yield "roll_out", {"task": TASK, "actions": [[0.5, 0.5, 0.5]], "latents": {"restitution": 7}}, "restitution"
    yield "roll_out", {"task": TASK, "actions": [[0.5, 0.5, 0.5]], "effects": [{"name": "magic"}]}, "magic"
    yield "roll_out", {"task": TASK, "actions": [[0.5, 0.5, 0.5]], "film": 1}, "`film`"
    yield "roll_out", {"scene": {"format": "iplw.scene/9"}}, "scene"
    yield "propose_actions", {"task": TASK, "strategy": "guess"}, "guess"
    yield "propose_actions", {"task": TASK, "actions": -1}, "actions"
    yield "measure", {"task": TASK}, "`action`"
    yield "measure", {"task": TASK, "action": [0.1, 0.2, 0.3], "proposal": 1}, "`proposal`"
    yield "measure", {"task": TASK, "proposal": 0}, "propose_actions"
    yield "measure", {"task": TASK, "action": [0.1, 0.2, 7]}, "7"
    yield "measure", {"task": "curling:001", "action": [0.1, 0.2, 0.3]}, "curling"
    yield "estimate", {"task": "bowling", "fit": ["magic.c"]}, "magic"
    yield "estimate", {"task": "bowling", "seconds": 0}, "`seconds`"
    yield "diagnose", {}, "scene"
    yield "diagnose", {"trials": "a,b\n1,2\n", "ball": {"radius": 0.02}}, "trials"
    yield "diagnose", {"trials": 7, "ball": {"radius": 0.02}}, "trials"
    yield "diagnose", {"trials": "t,x,y\n0,1,2\n", "ball": {"radius": -1}}, "ball.radius"
    yield "diagnose", {"explored": TASK}, "propose_actions"


def test_rejects_invalid_input_without_cost() -> None:
    async def conversation() -> None:
        async with agent() as client:
            for tool, arguments, named in bad():
                text_out = await refusal(client, tool, **arguments)
                assert named in text_out, f"{tool} {arguments}: {text_out}"
            with pytest.raises(MCPError, match="available: list_tasks, look"):
                await client.call_tool("fly", {})
            # An invalid action is an outcome and costs nothing.
            outside = await call(client, "measure", task=TASK, action=[0.0, 0.0, 1.0])
            assert outside["reason"] and outside["solved"] is None and outside["budget"]["spent"] == 0

    run(conversation)


def test_cancels_tool_call(tmp_path: Path) -> None:
    async def conversation() -> None:
        started = asyncio.Event()

        async def hear(progress: float, total: float | None, message: str | None) -> None:
            started.set()

        log = tmp_path / "log"
        async with agent("--real-interactions", "5000", log=log) as client:
            long = {"task": "bowling", "rounds": 50, "actions": 50, "seconds": 600}
            under_way = asyncio.create_task(client.call_tool("estimate", long, progress_callback=hear))
            await started.wait()
            under_way.cancel()
            with pytest.raises(asyncio.CancelledError):
                await under_way
            deadline = time.monotonic() + 20.0
            while not (line := ended(log)) and time.monotonic() < deadline:
                await asyncio.sleep(0.05)
            assert line and json.loads(line)["state"] == "cancelled"
            assert "2 s" in await refusal(client, "estimate", **{**long, "seconds": 2})
            assert (await call(client, "list_tasks"))["families"]

    run(conversation)


def ended(log: Path) -> str | None:
    """The log line of an ended job."""
    lines = log.read_text(encoding="utf-8").splitlines()
    return next((line for line in lines if '"event":"job"' in line), None)


def test_budget_persists_and_can_be_raised(tmp_path: Path) -> None:
    async def spent(most: str, measure: bool) -> dict[str, int]:
        async with agent("--data-dir", str(tmp_path), "--real-interactions", most) as client:
            if measure:
                rollouts = await call(client, "roll_out", task=TASK, actions=GRID)
                action = next(row["action"] for row in rollouts["results"] if row["reason"] is None)
                await call(client, "measure", task=TASK, action=action)
            budget = (await call(client, "look", task=TASK))["budget"]
            return {name: int(value) for name, value in budget.items()}

    async def conversation() -> None:
        assert await spent("2", True) == {"limit": 2, "spent": 1, "remaining": 1}
        assert await spent("2", False) == {"limit": 2, "spent": 1, "remaining": 1}
        assert await spent("3", True) == {"limit": 3, "spent": 2, "remaining": 1}
        assert await spent("1", False) == {"limit": 1, "spent": 2, "remaining": 0}

    run(conversation)


GRID = [[x, y, 0.2] for x in (0.3, 0.5, 0.7, 0.9) for y in (0.5, 0.7, 0.9)]


def test_scope_limits_agent(tmp_path: Path) -> None:
    new = [str(find_binary()), "token", "new", "ann", "--scope", "act", "--data-dir", str(tmp_path)]
    token = subprocess.run(new, check=True, capture_output=True, text=True).stdout.split()[-1]

    async def conversation() -> None:
        for place, displayed in [((), None), (("--data-dir", str(tmp_path)), token)]:
            async with agent("--scope", "read", *place, token=displayed) as client:
                assert (await call(client, "look", task=TASK))["things"]
                for text_out in [
                    await refusal(client, "measure", task=TASK, action=GRID[0]),
                    await refusal(client, "roll_out", task=TASK, actions=GRID),
                ]:
                    assert "scope read" in text_out and "requires act" in text_out
        async with agent("--data-dir", str(tmp_path), token=token) as client:
            assert (await call(client, "roll_out", task=TASK, actions=GRID))["results"]

    run(conversation)
    for bad_value in ({}, {"IPLW_TOKEN": "iplw_wrong"}):
        clean = {name: value for name, value in os.environ.items() if name != "IPLW_TOKEN"}
        command = [str(find_binary()), "mcp", "--data-dir", str(tmp_path)]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, env={**clean, **bad_value})
        assert done.returncode == 2 and "IPLW_TOKEN" in done.stderr and done.stdout == ""


def test_ends_with_stdin_and_prints_only_protocol() -> None:
    hello = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "initialize",
        "params": {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "test", "version": "1"},
        },
    }
    lines = [hello, {"jsonrpc": "2.0", "method": "notifications/initialized"}]
    sent = "".join(json.dumps(line) + "\n" for line in lines) + "no JSON\n"
    done = subprocess.run(
        [str(find_binary()), "mcp"], input=sent, capture_output=True, text=True, timeout=20.0, check=False
    )
    assert done.returncode == 0, done.stderr
    text_out = [json.loads(line) for line in done.stdout.splitlines()]
    assert text_out[0]["result"]["protocolVersion"] == "2025-06-18"
    assert all(line["jsonrpc"] == "2.0" for line in text_out)
    # No server.
    none = subprocess.run([str(find_binary()), "mcp"], stdin=subprocess.DEVNULL, capture_output=True, timeout=20.0)
    assert none.returncode == 0 and none.stdout == b""
