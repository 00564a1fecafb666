"""The asynchronous client: the same handles, awaited, many at once."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import pytest

import iplw

Body = Callable[[iplw.AsyncClient], Coroutine[Any, Any, None]]


@pytest.fixture(params=[None, "tcp://private"], ids=["http", "zmq"])
def url(request: pytest.FixtureRequest) -> str | None:
    return request.param  # type: ignore[no-any-return]


def run(url: str | None, body: Body, **settings: Any) -> None:
    async def whole() -> None:
        async with iplw.AsyncClient(url, **settings) as client:
            await body(client)

    asyncio.run(whole())


def test_the_same_as_the_client_that_waits(url: str | None, client: iplw.Client) -> None:
    async def body(own: iplw.AsyncClient) -> None:
        async with await own.create_world("bowling") as world:
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
            assert id in {w.id for w in await own.worlds()}
        with pytest.raises(iplw.Problem):
            await own.world(id)
        assert len(await own.task_ids("bowling", "test")) == 20
        assert (await own.task("bowling:017"))["id"] == "bowling:017"

    run(url, body)


def test_jobs(url: str | None, capsys: pytest.CaptureFixture[str]) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        job = await client.iplw("bowling", real={"damping": 0.8}, rounds=1, actions=2, samples=20, seed=1)
        result = await job.wait(progress=True)
        assert {row["name"] for row in result["latents"]} == {"density", "friction", "restitution"}
        assert len(await job.trials()) == result["real_interactions"]
        slow = await client.iplw("bowling", real={"damping": 0.8}, rounds=10, actions=50, samples=1000)
        with pytest.raises(TimeoutError, match="goes on"):
            await slow.wait(timeout=0.0)
        await slow.cancel()
        with pytest.raises(iplw.JobCancelled):
            await slow.wait(timeout=60)

    run(url, body)
    assert capsys.readouterr().err.startswith("iplw: ")


def test_many_at_once(url: str | None) -> None:
    async def body(client: iplw.AsyncClient) -> None:
        async def episode(seed: int) -> str:
            async with await client.create_world("bowling") as world:
                _, info = await world.reset(seed=seed)
                await world.step([0.5, 0.5, 0.2])
                return str(info["task"])

        once = await asyncio.gather(*(episode(seed) for seed in range(40)))
        assert once == [await episode(seed) for seed in range(40)], "no answer goes to another's request"

    run(url, body)


def test_cancelling_a_task_leaves_the_client_well(url: str | None) -> None:
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


def test_nobody_there_and_closed() -> None:
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
