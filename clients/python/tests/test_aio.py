"""The asynchronous client: the same methods, awaited, and concurrent requests."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from router import router
from stub import reply, serving

import iplw

Body = Callable[[iplw.AsyncClient], Coroutine[Any, Any, None]]


@pytest.fixture(params=[None, "tcp://private"], ids=["http", "zmq"])
def url(request: pytest.FixtureRequest) -> str | None:
    return request.param  # type: ignore[no-any-return]


def run(url: str | None, body: Body, **settings: Any) -> None:
    async def complete() -> None:
        async with iplw.AsyncClient(url, **settings) as client:
            await body(client)

    asyncio.run(complete())


def test_matches_synchronous_client(url: str | None, client: iplw.Client) -> None:
    async def body(separate: iplw.AsyncClient) -> None:
        async with await separate.create_world("bowling") as world:
            with client.create_world("bowling") as other:
                np.testing.assert_equal(await world.reset(seed=3), other.reset(seed=3))
                actions = np.random.default_rng(0).random((16, 3))
                ours, theirs = await world.rollout(actions, trajectories=True), other.rollout(actions, trajectories=True)
                assert [r.steps for r in ours] == [r.steps for r in theirs]
                best = int(ours.valid.argmax())
                np.testing.assert_equal(await world.step(actions[best]), other.step(actions[best]))
                assert await world.interactions() == other.interactions
                await world.set_latents(friction=0.1)
                assert world.latents is not None and world.latents["friction"] == 0.1
                assert (await world.render(width=64)).startswith(b"\x89PNG")
            id = world.id
            assert id in {w.id for w in await separate.worlds()}
        with pytest.raises(iplw.Problem):
            await separate.world(id)
        assert len(await separate.task_ids("bowling", "test")) == 20
        assert (await separate.task("bowling:017"))["id"] == "bowling:017"

    run(url, body)


def test_jobs(url: str | None, capsys: pytest.CaptureFixture[str]) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        job = await client.iplw("bowling", real={"damping": 0.8}, rounds=1, actions=2, samples=20, seed=1)
        result = await job.wait(progress=True)
        assert {row["name"] for row in result["latents"]} == {"density", "friction", "restitution"}
        assert len(await job.trials()) == result["real_interactions"]
        slow = await client.iplw("bowling", real={"damping": 0.8}, rounds=10, actions=50, samples=1000)
        with pytest.raises(TimeoutError, match="it continues"):
            await slow.wait(timeout=0.0)
        await slow.cancel()
        with pytest.raises(iplw.JobCancelled):
            await slow.wait(timeout=60)

    run(url, body)
    assert capsys.readouterr().err.startswith("iplw: ")


def test_concurrent_episodes(url: str | None) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        async def episode(seed: int) -> str:
            async with await client.create_world("bowling") as world:
                _, info = await world.reset(seed=seed)
                await world.step([0.5, 0.5, 0.2])
                return str(info["task"])

        once = await asyncio.gather(*(episode(seed) for seed in range(40)))
        assert once == [await episode(seed) for seed in range(40)], "responses match their requests"

    run(url, body)


def test_client_usable_after_cancelled_task(url: str | None) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        async with await client.create_world("bowling", engine="rapier") as world:
            await world.reset(seed=1)
            task = asyncio.create_task(world.rollout(range(512), stop=False))
            await asyncio.sleep(0.2)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            start = time.monotonic()
            assert (await client.world("bowling-sim")).id == "bowling-sim"
            assert time.monotonic() - start < 5

    run(url, body)


def test_unreachable_server_and_closed_client() -> None:
    for url in ("http://127.0.0.1:1", "tcp://127.0.0.1:1"):

        async def body(client: iplw.AsyncClient) -> None:
            with pytest.raises(iplw.ServerUnavailable, match="no iplw server at"):
                await client.worlds()
            await client.close()
            with pytest.raises(iplw.ServerUnavailable, match="closed"):
                await client.worlds()

        run(url, body, timeout=2)
    with pytest.raises(ValueError, match="concurrency is 0; allowed"):
        iplw.AsyncClient("http://127.0.0.1:1", concurrency=0)
    with pytest.raises(ValueError, match="timeout is 0; allowed"):
        iplw.AsyncClient("tcp://127.0.0.1:1", timeout=0)


def test_cancelled_task_notifies_server() -> None:
    with router(lambda header: None) as (url, observed):

        async def body(client: iplw.AsyncClient) -> None:
            task = asyncio.create_task(client.worlds())
            while not observed:
                await asyncio.sleep(0.01)
            start = time.monotonic()
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert time.monotonic() - start < 1
            while len(observed) < 2 and time.monotonic() < start + 5:
                await asyncio.sleep(0.01)

        run(url, body)
    assert [header["op"] for header in observed] == ["list_worlds", "cancel"]
    assert observed[1]["args"] == {"request": observed[0]["id"]}


def test_follow_job_and_stop(url: str | None) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        job = await client.iplw("basketball", rounds=2, actions=3, samples=32, seed=3)
        states = [data["state"] async for data in job.follow()]
        assert states[-1] == job.state == "succeeded" and "succeeded" not in states[:-1]
        slow = await client.iplw("bowling", real={"damping": 0.8}, rounds=10, actions=50, samples=1000)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(slow.wait(), 0.3)
        # More jobs than threads: waiting occupies no request thread.
        waits = [asyncio.create_task(slow.wait()) for _ in range(6)]
        await asyncio.sleep(0.1)
        assert (await client.world("bowling-sim")).id == "bowling-sim"
        await slow.cancel()
        for wait in waits:
            with pytest.raises(iplw.JobCancelled):
                await wait

    run(url, body, concurrency=4)


def test_stops_silent_event_stream_at_once() -> None:
    job = json.dumps({"id": "j", "kind": "iplw", "state": "running"})

    def answer(n: int, method: str, path: str) -> bytes:
        if path.endswith("/events"):
            return b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nContent-Length: 99\r\n\r\n"
        return reply("200 OK", job)

    async def body(client: iplw.AsyncClient) -> None:
        start, held = time.monotonic(), await client.job("j")
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(held.wait(), 0.3)
        while any(thread.name.startswith("iplw-events") for thread in threading.enumerate()):
            await asyncio.sleep(0.01)
            assert time.monotonic() - start < 5, "its thread ends"

    with serving(answer, hold=True) as stub:
        run(stub.url, body, timeout=60)


def test_ask_tell_and_files(url: str | None, tmp_path: Path) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        job = await client.iplw("basketball", real="ask_tell", rounds=1, actions=2, samples=16, seed=2)
        assert isinstance(job, iplw.AsyncAskTellJob) and isinstance(await client.job(job.id), iplw.AsyncAskTellJob)
        async with await client.create_world("basketball", kind="real") as world:
            while proposals := await job.proposals():
                for proposal in proposals:
                    result = (await world.rollout([proposal.action], task=proposal.task, trajectories=True))[0]
                    assert result.t is not None
                    await job.tell(proposal, result.t, {name: s[:, :2] for name, s in result.bodies.items()})
        assert (await job.wait())["real_interactions"] == 2
        await job.save_trials(tmp_path)
        assert (tmp_path / "trials.csv").read_text().startswith("trial,setting,t,body,x,y")
        assert len((await client.family("basketball"))["tasks"]) == 25

    run(url, body)


def test_surfaces_and_raw_operations(url: str | None) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        job = await client.start("find_surface", task="basketball", points=3, actions=100, seed=6)
        id = (await job.wait())["surface"]
        surface = await client.surface(id)
        assert (await surface.points())["format"] == "iplw.surface/1" and b"<svg" in await surface.draw()
        await surface.delete()
        assert id not in {surface.id for surface in await client.surfaces()}
        assert (await client.call("get_world", id="bowling-sim"))["id"] == "bowling-sim"

    run(url, body)


def test_clients_have_equal_methods() -> None:
    for name in ("AskTellJob", "Client", "Job", "Policy", "Surface", "World"):
        waits, awaited = getattr(iplw, name), getattr(iplw, f"Async{name}")
        assert {n for n in dir(waits) if n[0] != "_"} == {n for n in dir(awaited) if n[0] != "_"}
