"""The client for asyncio: the same handles, awaited.

    async with iplw.AsyncClient("tcp://127.0.0.1:5555") as client:
        async with await client.create_world("bowling") as world:
            observation, info = await world.reset(seed=1)
            observation, reward, terminated, truncated, info = await world.step([0.5, 0.8, 0.3])
        found = await (await client.iplw("bowling", real={"damping": 0.8})).wait()

Over ZeroMQ one connection carries all requests under way; over HTTP each takes a thread. Cancelling a task stops the
waiting; over ZeroMQ the server is told, too.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from numpy.typing import NDArray
from typing_extensions import Self

from . import calls, server
from .client import PRIVATE
from .errors import Problem, ServerUnavailable
from .handle import Named
from .job import Bar, JobData, in_time
from .operations import Call, given
from .policy import Ranked, ranked
from .rollout import Action, Rollout, Rollouts
from .transport import Pause, closed, connect, page, scheme_of
from .world import WorldData

if TYPE_CHECKING:
    from .zeromq import AsyncZeroMq

T = TypeVar("T")
#: Longest time between two looks at a job, s.
POLL = 0.25


class AsyncClient:
    """A connection to an iplw server; also an asynchronous context manager. Arguments as for `Client`.

    `concurrency`: most requests under way at once; more wait for their turn.
    """

    def __init__(
        self,
        url: str | None = None,
        *,
        timeout: float = 30.0,
        binary: str | os.PathLike[str] | None = None,
        concurrency: int = 32,
    ) -> None:
        #: The private server, if this client uses one.
        self.server: server.PrivateServer | None = None
        private = PRIVATE.get(url)
        if private is not None:
            self.server = server.acquire(binary)
        try:
            address = self.server.address(private) if self.server and private else str(url)
            advice = self.server.advice if self.server else None
            self._line: Line = _line(address, timeout, advice, concurrency)
        except BaseException:
            self._release()
            raise

    @property
    def url(self) -> str:
        """The server's address."""
        return self._line.url

    async def worlds(self) -> list[AsyncWorld]:
        """Every world on the server."""
        return [AsyncWorld(self._line, data) async for data in self._line.items("list_worlds", "worlds")]

    async def world(self, id: str) -> AsyncWorld:
        """The world with this id."""
        return AsyncWorld(self._line, await self._line.do(calls.get("get_world", id)))

    async def create_world(
        self,
        task: str | None = None,
        *,
        scene: Mapping[str, Any] | None = None,
        kind: str | None = None,
        engine: str | None = None,
        latents: Mapping[str, float] | None = None,
        effects: Sequence[Mapping[str, Any]] | None = None,
        damping: float | None = None,
        noise: float | None = None,
        budget: int | None = None,
        sealed: bool | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncWorld:
        """A new world, as with `Client.create_world`."""
        body = given(
            task=task,
            scene=scene,
            kind=kind,
            engine=engine,
            latents=latents,
            effects=effects,
            damping=damping,
            noise=noise,
            budget=budget,
            sealed=sealed,
            seed=seed,
        )
        return AsyncWorld(self._line, await self._line.do(calls.create_world(body, key)))

    async def tasks(self) -> list[dict[str, Any]]:
        """The task families."""
        return [family async for family in self._line.items("list_families", "families")]

    async def task(self, id: str) -> dict[str, Any]:
        """One task, `bowling:017`."""
        return await self._line.do(calls.number_of(id))

    async def task_ids(self, family: str, split: str | None = None) -> list[str]:
        """Ids of a family's tasks, all or those of one split, in order."""
        listed = self._line.items("list_tasks", "tasks", {"family": family})
        return calls.ids([task async for task in listed], split)

    async def iplw(
        self,
        task: str,
        *,
        world: AsyncWorld | str | None = None,
        real: Mapping[str, Any] | None = None,
        strategy: str | None = None,
        residual: str | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """The workflow as a job, as with `Client.iplw`."""
        body = given(
            task=task,
            world=world.id if isinstance(world, AsyncWorld) else world,
            real=real,
            strategy=strategy,
            residual=residual,
            rounds=rounds,
            actions=actions,
            samples=samples,
            seed=seed,
            budget=budget,
        )
        return AsyncJob(self._line, await self._line.do(calls.post("start_iplw", body, key)))

    async def train(
        self,
        task: str,
        *,
        training: str | None = None,
        latents: Mapping[str, float] | None = None,
        effects: Sequence[Mapping[str, Any]] | None = None,
        batches: int | None = None,
        batch_size: int | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Trains a policy as a job, as with `Client.train`."""
        body = given(
            task=task,
            training=training,
            latents=latents,
            effects=effects,
            batches=batches,
            batch_size=batch_size,
            seed=seed,
        )
        return AsyncJob(self._line, await self._line.do(calls.post("train_policy", body, key)))

    async def diagnose(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: str | None = None,
        *,
        job: AsyncJob | str | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """What the simulation gets wrong, by name, as a job: of a scene and trials as CSV, or of a job's trials."""
        body = given(
            scene=scene, trials=trials, job=job.id if isinstance(job, AsyncJob) else job, seed=seed
        )
        return AsyncJob(self._line, await self._line.do(calls.post("start_diagnosis", body, key)))

    async def find_surface(
        self,
        task: str,
        *,
        factors: Sequence[str] | None = None,
        points: int | None = None,
        route: str | None = None,
        actions: int | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Which latent factors a family's performance depends on, as a job."""
        body = given(
            task=task, factors=factors, points=points, route=route, actions=actions, seed=seed
        )
        return AsyncJob(self._line, await self._line.do(calls.post("find_surface", body, key)))

    async def policies(self) -> list[AsyncPolicy]:
        """Every policy on the server."""
        return [AsyncPolicy(self._line, data) async for data in self._line.items("list_policies", "policies")]

    async def policy(self, id: str) -> AsyncPolicy:
        """The policy with this id."""
        return AsyncPolicy(self._line, await self._line.do(calls.get("get_policy", id)))

    async def upload_policy(self, id: str, weights: bytes | str | Path) -> AsyncPolicy:
        """Creates or replaces the policy `id` from safetensors bytes or a file of them."""
        data = weights if isinstance(weights, bytes) else Path(weights).read_bytes()
        await self._line.do(calls.upload(id, data))
        return await self.policy(id)

    async def jobs(self) -> list[AsyncJob]:
        """Every job on the server."""
        return [AsyncJob(self._line, data) async for data in self._line.items("list_jobs", "jobs")]

    async def job(self, id: str) -> AsyncJob:
        """The job with this id."""
        return AsyncJob(self._line, await self._line.do(calls.get("get_job", id)))

    async def close(self) -> None:
        """Drops the connection and gives the private server back; a second call does nothing."""
        await self._line.close()
        if self.server is not None:
            await asyncio.to_thread(self._release)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        private = f", private server {self.server.pid}" if self.server else ""
        return f"<iplw.AsyncClient {self.url}{private}>"

    def _release(self) -> None:
        held, self.server = self.server, None
        if held is not None:
            server.release(held)


class AsyncHandle(Named):
    """A handle whose answers are awaited."""

    def __init__(self, line: Line, data: dict[str, Any]) -> None:
        super().__init__(data)
        self._line = line

    async def refresh(self) -> Self:
        """Looks again."""
        self.data = await self._line.do(calls.get(self._look, self.id))
        return self


class AsyncWorld(WorldData, AsyncHandle):
    """A handle on one world; also an asynchronous context manager that deletes it."""

    _closed = False

    async def interactions(self) -> int:
        """Valid attempts on this world so far."""
        return int((await self.refresh()).data["interactions"])

    async def reset(
        self, *, seed: int | None = None, task: str | None = None, split: str | None = None
    ) -> calls.Start:
        """Starts an episode: (observation, info)."""
        return await self._line.do(calls.reset(self.id, seed, task, split))

    async def step(self, action: Action) -> calls.Step:
        """Acts once: (observation, reward, terminated, truncated, info)."""
        return await self._line.do(calls.step(self.id, action))

    async def rollout(
        self,
        actions: Sequence[Action] | NDArray[Any],
        *,
        task: str | None = None,
        trajectories: bool = False,
        stop: bool = True,
        batch: int = 1024,
    ) -> Rollouts:
        """Rolls out many actions on one task, as `World.rollout` does."""
        results: list[Rollout] = []
        for call in calls.rollouts(self.id, actions, task, trajectories, stop, batch):
            part = await self._line.do(call)
            results.extend(part)
        return Rollouts(results)

    async def evaluate(
        self, ranking: Mapping[str, Sequence[Action] | NDArray[Any]], *, attempts: int = 100
    ) -> AsyncJob:
        """AUCCESS of a policy of your own, as `World.evaluate` does."""
        answer = await self._line.do(calls.evaluate_ranking(self.id, ranking, attempts))
        return AsyncJob(self._line, answer)

    async def set_latents(self, **latents: float) -> Self:
        """Sets some of density (or mass), friction, restitution."""
        self.data = await self._line.do(calls.set_latents(self.id, latents))
        return self

    async def render(
        self,
        *,
        format: str = "png",
        view: str = "scene",
        action: Action | None = None,
        task: str | None = None,
        width: int | None = None,
    ) -> bytes:
        """A picture, as `World.render` gives it."""
        return await self._line.do(calls.render(self.id, format, view, action, task, width))

    async def close(self) -> None:
        """Deletes the world; a second call does nothing, nor does a world or server that is already gone."""
        if self._closed:
            return
        self._closed = True
        with suppress(ServerUnavailable):
            try:
                await self._line.do(calls.get("delete_world", self.id))
            except Problem as problem:
                if problem.status != 404:
                    raise

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()


class AsyncJob(JobData, AsyncHandle):
    """A handle on one job."""

    async def wait(self, progress: bool = False, timeout: float | None = None) -> dict[str, Any]:
        """The job's result, once it has one; `progress` and what is raised as with `Job.wait`."""
        bar = Bar() if progress else None
        deadline = None if timeout is None else time.monotonic() + timeout
        # Often at first, for the short ones.
        pause = POLL / 16
        try:
            while not self.ended:
                await self.refresh()
                if bar:
                    bar.draw(self.data)
                if not self.ended:
                    in_time(self.id, deadline)
                    await asyncio.sleep(pause)
                    pause = min(2 * pause, POLL)
        finally:
            if bar:
                bar.finish()
        return self.result()

    async def cancel(self) -> None:
        """Asks the server to stop the job; does nothing to one that has ended."""
        if not (await self.refresh()).ended:
            await self._line.do(calls.cancel(self.id))

    async def trials(self) -> list[dict[str, Any]]:
        """What an estimation has measured."""
        return [trial async for trial in self._line.items("list_trials", "trials", {"id": self.id})]


class AsyncPolicy(AsyncHandle):
    """A handle on one policy."""

    _look = "get_policy"

    async def act(self, task: str, count: int = 10) -> list[Ranked]:
        """The policy's `count` best actions on a task, best first."""
        answer = await self._line.do(calls.act(self.id, task, count))
        return ranked(answer)

    async def evaluate(
        self, world: AsyncWorld | str, *, split: str = "test", attempts: int = 100
    ) -> AsyncJob:
        """AUCCESS on a world's tasks, as a job."""
        name = world.id if isinstance(world, AsyncWorld) else world
        return AsyncJob(self._line, await self._line.do(calls.evaluate(self.id, name, split, attempts)))

    async def learn(
        self,
        world: AsyncWorld | str,
        *,
        attempts: int | None = None,
        batches: int | None = None,
        batch_size: int | None = None,
        learning_rate: float | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Learns on in a world, as a job whose result names the new policy; attempts are counted there."""
        body = given(
            id=self.id,
            world=world.id if isinstance(world, AsyncWorld) else world,
            attempts=attempts,
            batches=batches,
            batch_size=batch_size,
            learning_rate=learning_rate,
            seed=seed,
        )
        return AsyncJob(self._line, await self._line.do(calls.post("learn_policy", body, key)))

    async def download(self) -> bytes:
        """The weights as safetensors bytes."""
        return await self._line.do(calls.weights(self.id))

    async def delete(self) -> None:
        """Removes the policy from the server."""
        await self._line.do(calls.get("delete_policy", self.id))


class Line(ABC):
    """What `Transport` is to the client that waits."""

    def __init__(self, url: str, timeout: float) -> None:
        self.url = url
        self.timeout = timeout

    async def do(self, call: Call[T]) -> T:
        """Carries one call out, as `Transport.do` does."""
        pause = None
        while True:
            try:
                return call.read(await self.send(call))
            except Problem as problem:
                pause = pause or Pause(self.timeout)
                wait = pause.after(problem)
                if wait is None:
                    raise
                await asyncio.sleep(wait)

    @abstractmethod
    async def send(self, call: Call[Any]) -> Any:
        """The answer as it came."""

    async def items(
        self, op: str, name: str, args: Mapping[str, Any] | None = None
    ) -> AsyncIterator[Any]:
        """All items of the list `name`, page by page."""
        cursor: str | None = None
        while True:
            answer = await self.do(page(op, args or {}, cursor))
            for item in answer[name]:
                yield item
            cursor = answer.get("next")
            if cursor is None:
                return

    @abstractmethod
    async def close(self) -> None:
        """Drops the connections."""


class _Threads(Line):
    """HTTP: a thread for each request under way."""

    def __init__(
        self, url: str, timeout: float, advice: Callable[[], str] | None, concurrency: int
    ) -> None:
        self._transport = connect(url, timeout, advice)
        super().__init__(self._transport.url, timeout)
        self._threads = ThreadPoolExecutor(concurrency, "iplw-async")
        self._closed = False

    async def send(self, call: Call[Any]) -> Any:
        if self._closed:
            raise closed()
        return await asyncio.get_running_loop().run_in_executor(self._threads, self._transport.send, call)

    async def close(self) -> None:
        self._closed = True
        self._transport.close()
        self._threads.shutdown(wait=False, cancel_futures=True)


class _Multiplexed(Line):
    """ZeroMQ: every request over one connection, answers in any order."""

    def __init__(
        self, url: str, timeout: float, advice: Callable[[], str] | None, concurrency: int
    ) -> None:
        # Checks the arguments and says what to install if that is missing.
        connect(url, timeout).close()
        super().__init__(url, timeout)
        self._advice = advice
        self._numbers = itertools.count(1)
        self._made: AsyncZeroMq | None = None
        self._making = asyncio.Lock()
        # The server refuses a peer that asks for more than 128 things at once.
        self._turns = asyncio.Semaphore(concurrency)
        self._closed = False

    async def send(self, call: Call[Any]) -> Any:
        from .zeromq import REPEATS, Broken, broke

        repeats = REPEATS if call.repeatable else 0
        while True:
            try:
                async with self._turns:
                    return await (await self._connection()).send(next(self._numbers), call)
            except Broken as lost:
                if repeats == 0:
                    raise broke(self.url, call.op, self._advice) from lost
                repeats -= 1
                await asyncio.sleep(0.1)

    async def close(self) -> None:
        self._closed = True
        if self._made is not None:
            self._made.close()

    async def _connection(self) -> AsyncZeroMq:
        from .zeromq import AsyncZeroMq

        if self._closed:
            raise closed()
        made = self._made
        if made is not None and made.usable():
            return made
        async with self._making:
            if self._made is None or not self._made.usable():
                self._made = await AsyncZeroMq.made(self.url, self.timeout, self._advice)
            return self._made


def _line(url: str, timeout: float, advice: Callable[[], str] | None, concurrency: int) -> Line:
    if concurrency < 1:
        raise ValueError(f"concurrency is {concurrency}; allowed: 1 or more")
    if scheme_of(url) in ("tcp", "ipc"):
        return _Multiplexed(url, timeout, advice, concurrency)
    return _Threads(url, timeout, advice, concurrency)
