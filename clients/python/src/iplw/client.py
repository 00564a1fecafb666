"""The way in: one client speaks to one server, of your own or a private one."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, overload

from . import calls, server
from .asking import Asking
from .job import Job
from .operations import given
from .policy import Policy
from .transport import Transport, connect
from .world import World

#: Addresses of a private server -> scheme.
PRIVATE = {None: "http", "tcp://private": "tcp"}


class Client:
    """A connection to an iplw server; also a context manager.

    `url`: `http://host:port`, or `tcp://host:port` or `ipc://path` for ZeroMQ, which needs `pip install
    'iplw[zmq]'`. Without one it starts a private server, shared by all such clients of this process and stopped
    when the last of them closes or the process ends, in whichever way; `tcp://private` is the same, spoken to over
    ZeroMQ. `timeout` is in seconds, for each request; batches get more by their size. Requests that only read or
    delete, or that carry a `key`, are repeated after a lost connection, others never.
    """

    def __init__(
        self,
        url: str | None = None,
        *,
        timeout: float = 30.0,
        binary: str | os.PathLike[str] | None = None,
    ) -> None:
        #: The private server, if this client uses one.
        self.server: server.PrivateServer | None = None
        private = PRIVATE.get(url)
        if private is not None:
            self.server = server.acquire(binary)
        try:
            address = self.server.address(private) if self.server and private else str(url)
            self._transport = connect(address, timeout, self.server.advice if self.server else None)
        except BaseException:
            self._release()
            raise

    @property
    def url(self) -> str:
        """The server's address."""
        return self._transport.url

    def worlds(self) -> list[World]:
        """Every world on the server."""
        return [World(self._transport, data) for data in self._transport.items("list_worlds", "worlds")]

    def world(self, id: str) -> World:
        """The world with this id; four are there from the start: `bowling-sim`, `bowling-real`, ..."""
        return World(self._transport, self._transport.do(calls.get("get_world", id)))

    def create_world(
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
    ) -> World:
        """A new world of a task family (`bowling`), a task (`bowling:017`) or a scene of your own.

        With a `key` of your choice, asking twice makes one world.

        Close it, or use it as a context manager; else it goes when it has been idle for long.
        """
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
        return World(self._transport, self._transport.do(calls.create_world(body, key)))

    def tasks(self) -> list[dict[str, Any]]:
        """The task families: name, about, number of tasks, split, action space."""
        return list(self._transport.items("list_families", "families"))

    def family(self, name: str) -> dict[str, Any]:
        """One family with the id, split and certificate of each of its tasks."""
        family = self._transport.do(calls.post("list_tasks", {"family": name, "limit": 1}))
        family["tasks"] = list(self._transport.items("list_tasks", "tasks", {"family": name}))
        return family

    def task(self, id: str) -> dict[str, Any]:
        """One task, `bowling:017`: its split, scene and certificate."""
        return self._transport.do(calls.number_of(id))

    def task_ids(self, family: str, split: str | None = None) -> list[str]:
        """Ids of a family's tasks, all or those of one split, in order."""
        return calls.ids(self.family(family)["tasks"], split)

    @overload
    def iplw(
        self,
        task: str,
        *,
        real: Literal["ask_tell"],
        strategy: str | None = None,
        residual: str | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> Asking: ...
    @overload
    def iplw(
        self,
        task: str,
        *,
        world: World | str | None = None,
        real: Mapping[str, Any] | None = None,
        strategy: str | None = None,
        residual: str | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> Job: ...
    def iplw(
        self,
        task: str,
        *,
        world: World | str | None = None,
        real: Mapping[str, Any] | Literal["ask_tell"] | None = None,
        strategy: str | None = None,
        residual: str | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> Job:
        """The workflow: explore, measure on the real world, estimate latents. As a job.

        `world` is a real world on the server, whose interactions are counted there; `real` describes one
        instead: `{"damping": 0.8}`; with `real="ask_tell"` it is yours, and the job asks what to measure. With a
        `key` of your choice, asking twice starts one job.
        """
        body = given(
            task=task,
            world=world.id if isinstance(world, World) else world,
            real=real,
            strategy=strategy,
            residual=residual,
            rounds=rounds,
            actions=actions,
            samples=samples,
            seed=seed,
            budget=budget,
        )
        return _job(self._transport, self._transport.do(calls.post("start_iplw", body, key)))

    def train(
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
    ) -> Job:
        """Trains a policy in simulation, as a job; `client.policy(job.wait()["policy"])` is the policy.

        `training` is `fixed` (these latents) or `randomised` (latents drawn anew for each task).
        """
        body = given(
            task=task,
            training=training,
            latents=latents,
            effects=effects,
            batches=batches,
            batch_size=batch_size,
            seed=seed,
        )
        return Job(self._transport, self._transport.do(calls.post("train_policy", body, key)))

    def diagnose(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: str | None = None,
        *,
        job: Job | str | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> Job:
        """What the simulation gets wrong, by name, as a job: of a scene and trials as CSV, or of a job's trials."""
        body = given(
            scene=scene, trials=trials, job=job.id if isinstance(job, Job) else job, seed=seed
        )
        return Job(self._transport, self._transport.do(calls.post("start_diagnosis", body, key)))

    def find_surface(
        self,
        task: str,
        *,
        factors: Sequence[str] | None = None,
        points: int | None = None,
        route: str | None = None,
        actions: int | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> Job:
        """Which latent factors a family's performance depends on, as a job."""
        body = given(
            task=task, factors=factors, points=points, route=route, actions=actions, seed=seed
        )
        return Job(self._transport, self._transport.do(calls.post("find_surface", body, key)))

    def policies(self) -> list[Policy]:
        """Every policy on the server."""
        return [Policy(self._transport, data) for data in self._transport.items("list_policies", "policies")]

    def policy(self, id: str) -> Policy:
        """The policy with this id."""
        return Policy(self._transport, self._transport.do(calls.get("get_policy", id)))

    def upload_policy(self, id: str, weights: bytes | str | Path) -> Policy:
        """Creates or replaces the policy `id` from safetensors bytes or a file of them."""
        data = weights if isinstance(weights, bytes) else Path(weights).read_bytes()
        self._transport.do(calls.upload(id, data))
        return self.policy(id)

    def jobs(self) -> list[Job]:
        """Every job on the server."""
        return [_job(self._transport, data) for data in self._transport.items("list_jobs", "jobs")]

    def job(self, id: str) -> Job:
        """The job with this id."""
        return _job(self._transport, self._transport.do(calls.get("get_job", id)))

    def close(self) -> None:
        """Drops the connection and gives the private server back; a second call does nothing."""
        self._transport.close()
        self._release()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        private = f", private server {self.server.pid}" if self.server else ""
        return f"<iplw.Client {self.url}{private}>"

    def _release(self) -> None:
        held, self.server = self.server, None
        if held is not None:
            server.release(held)


def _job(transport: Transport, data: dict[str, Any]) -> Job:
    asks = (data.get("config") or {}).get("real") == "ask_tell"
    return Asking(transport, data) if asks else Job(transport, data)
