"""The way in: a connection to a server, and the handles it gives."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, overload

from typing_extensions import Self

from .. import calls, server
from ..call import given
from ..connect import connect
from ..measured import Measured, texts
from ..rows import Rows
from ..runner import AsyncRunner
from ..scene import Scene
from .asking import AsyncAsking
from .job import AsyncJob
from .likelihood import AsyncLikelihood
from .line import AsyncLine
from .policy import AsyncPolicy
from .surface import AsyncSurface
from .world import AsyncWorld

#: Addresses of a private server -> scheme.
PRIVATE = {None: "http", "private": "http", "tcp://private": "tcp"}


class AsyncClient:
    """A connection to an iplw server; also a context manager.

    `url`: `http://host:port`, or `tcp://host:port` or `ipc://path` for ZeroMQ, which needs `pip install
    'iplw[zmq]'`. Without one it starts a private server, shared by all such clients of this process and stopped
    when the last of them closes or the process ends, in whichever way; `tcp://private` is the same, spoken to over
    ZeroMQ. `token` says who asks, where the server wants to know; `verify` is False, or the file of the certificates that
    are believed, over `https://`. Where `url` or `token` is absent, the environment's IPLW_URL and IPLW_TOKEN count; the
    address `private` is a private server all the same. `timeout` is in seconds, for each request; batches get more by their size. Requests that only read or
    delete, or that carry a `key`, are repeated after a lost connection, others never.
    """

    def __init__(
        self,
        url: str | None = None,
        *,
        token: str | None = None,
        verify: bool | str = True,
        timeout: float = 30.0,
        binary: str | os.PathLike[str] | None = None,
        concurrency: int = 32,  # async
    ) -> None:
        """`concurrency`: most requests under way at once; more wait for their turn."""  # async
        #: The private server, if this client uses one.
        self.server: server.PrivateServer | None = None
        runner = AsyncRunner(concurrency)  # async
        # sync: runner = Runner()
        url = url if url is not None else os.environ.get("IPLW_URL") or None
        private = PRIVATE.get(url)
        if private is not None:
            self.server = server.acquire(binary)
        try:
            address = self.server.address(private) if self.server and private else str(url)
            advice = self.server.advice if self.server else None
            who = None if private else token if token is not None else os.environ.get("IPLW_TOKEN") or None
            self._line = AsyncLine(connect(address, timeout, advice, who, verify), runner)
        except BaseException:
            self._release()
            raise

    @property
    def url(self) -> str:
        """The server's address."""
        return self._line.url

    async def worlds(self) -> list[AsyncWorld]:
        """Every world on the server."""
        return [AsyncWorld(self._line, data) for data in await self._line.items("list_worlds")]

    async def world(self, id: str) -> AsyncWorld:
        """The world with this id; four are there from the start: `bowling-sim`, `bowling-real`, ..."""
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
        """A new world of a task family (`bowling`), a task (`bowling:017`) or a scene of your own.

        - `scene`: an `iplw.scene/1` document with `action` and `goal`, instead of a task.
        - `kind`: `sim` (the default), or `real`: latents are hidden, valid attempts counted.
        - `engine`: `auto` (the default), `lanes` or `rapier`.
        - `latents`: some of density (kg/m^2), friction, restitution; those absent are the family's prior mean (sim) or
          its standard truth (real).
        - `effects`: physics beyond gravity and contact, `[{"name": "wind", "parameters": {"ax": 0.5}}]`, in SI;
          `damping`: the kept share of velocity per second, in (0, 1], short for one of them.
        - `noise`: standard deviation of what is observed, m; `budget`: most valid attempts. Real worlds only.
        - `sealed`: whether latents and effects are kept secret; as the kind has it if absent.
        - `seed`: of resets without one, and of noise.

        With a `key` of your choice, asking twice makes one world. Close it, or use it as a context manager; else it goes
        when it has been idle for long. `Problem` where something is not allowed, by name.
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
        return AsyncWorld(self._line, await self._line.do(calls.post("create_world", body, key)), scene)

    async def tasks(self) -> Rows:
        """The task families: name, about, number of tasks, split, action space."""
        return Rows(await self._line.items("list_families"))

    async def family(self, name: str) -> dict[str, Any]:
        """One family with the id, split and certificate of each of its tasks."""
        family = await self._line.do(calls.post("list_tasks", {"family": name, "limit": 1}))
        family["tasks"] = Rows(await self._line.items("list_tasks", family=name))
        return family

    async def task(self, id: str) -> dict[str, Any]:
        """One task, `bowling:017`: its split, scene and certificate."""
        task = await self._line.do(calls.task(id))
        return {**task, "scene": Scene(task["scene"])}

    async def task_ids(self, family: str, split: str | None = None) -> list[str]:
        """Ids of a family's tasks, all or those of one split, in order."""
        tasks = await self._line.items("list_tasks", family=family)
        return [str(task["id"]) for task in tasks if split is None or task["split"] == split]

    @overload
    async def iplw(
        self,
        task: str,
        *,
        real: Literal["ask_tell"],
        surface: str | None = None,
        strategy: str | None = None,
        residual: str | None = None,
        fit: Sequence[str] | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> AsyncAsking: ...
    @overload
    async def iplw(
        self,
        task: str,
        *,
        world: AsyncWorld | str | None = None,
        real: Mapping[str, Any] | None = None,
        surface: AsyncSurface | str | None = None,
        strategy: str | None = None,
        residual: str | None = None,
        fit: Sequence[str] | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> AsyncJob: ...
    async def iplw(
        self,
        task: str,
        *,
        world: AsyncWorld | str | None = None,
        real: Mapping[str, Any] | Literal["ask_tell"] | None = None,
        surface: AsyncSurface | str | None = None,
        strategy: str | None = None,
        residual: str | None = None,
        fit: Sequence[str] | None = None,
        rounds: int | None = None,
        actions: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
        budget: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """The workflow: explore, measure on the real world, estimate latents. As a job.

        `world` is a real world on the server, whose interactions are counted there; `real` describes one
        instead: `{"damping": 0.8}`; with `real="ask_tell"` it is yours, and the job asks what to measure. `surface`
        says which latents matter; `fit` names parameters of effects to estimate along: `["linear_drag.c"]`. With a
        `key` of your choice, asking twice starts one job.

        - `strategy`: which actions are spent: `collisions`, `rolling`, `random`, `mixed` (the default), `gradient`,
          `informative`; or, of what is drawn as known each round, `probing` (what tells most of latents and parameters)
          or `success` (what tells most of whether plans work), a minute a round.
        - `residual`: `trajectory` (the default), simulated from start to end; `shooting`, a stretch at a time from what
          was seen, which bears noise.
        - `rounds`: most rounds (5); `actions`: real interactions a round (10); `budget`: most in all; `samples`: latents
          tried per iteration of the search.

        The result has `latents`: rows of `name`, `value`, `ci95` and `identifiable`, density in kg/m^2; and
        `real_interactions`.
        """
        body = given(
            task=task,
            world=calls.id_of(world),
            real=real,
            surface=calls.id_of(surface),
            strategy=strategy,
            residual=residual,
            fit=fit,
            rounds=rounds,
            actions=actions,
            samples=samples,
            seed=seed,
            budget=budget,
        )
        return self._job(await self._line.do(calls.post("start_iplw", body, key)))

    async def train(
        self,
        task: str,
        *,
        training: str | None = None,
        belief: Mapping[str, Any] | None = None,
        latents: Mapping[str, float] | None = None,
        effects: Sequence[Mapping[str, Any]] | None = None,
        preset: str | None = None,
        batches: int | None = None,
        batch_size: int | None = None,
        validations: int | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Trains a policy in simulation, as a job; its result's `policy` is the policy's id.

        `training` is `fixed` (these latents) or `randomised` (latents drawn anew for each rollout); instead of it, of `latents`
        and of `effects`, `belief` is what is known: a posterior (an `iplw.posterior/1` document), in whose draws actions
        are labelled. `preset` is `paper`, so many `batches`, or `saturating`: until AUCCESS on validation tasks in the
        same simulation grows no more, told in the result as `validation`; the best weights are kept. `validations`
        looks so often at AUCCESS on validation tasks, told in the result. `latents`: some of density (kg/m^2), friction,
        restitution, those absent at the family's prior mean; `effects`: of the simulation, in SI. `batches` updates of
        `batch_size` examples; the family's own numbers if absent.
        """
        body = given(
            task=task,
            training=training,
            belief=belief,
            latents=latents,
            effects=effects,
            preset=preset,
            batches=batches,
            batch_size=batch_size,
            validations=validations,
            seed=seed,
        )
        return self._job(await self._line.do(calls.post("train_policy", body, key)))

    async def diagnose(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: Measured | None = None,
        *,
        ball: Mapping[str, float] | None = None,
        reading: Mapping[str, Any] | None = None,
        job: AsyncJob | str | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """What the simulation gets wrong, by name, as a job: of a scene and trials, or of a job's trials.

        `trials`: a file (its path, or its text), a pandas frame, or a list of arrays (n, 3) of t (s), x and y (m), each a
        trial; lists and mappings of files and frames, too. Of one body columns may be called as tracking programs do;
        what they do not say `reading` does: `{"fps": 240, "metres_per_pixel": 0.002, "y_down": True}`. Where one
        ball flies, `ball={"radius": 0.02, "floor": 0.0}` does instead of a scene: m; `mass` in kg, `gravity` in m/s^2.

        The result has `verdict` (`none`, `named`, `ambiguous`, `unknown`, `insufficient_data`), `effects` with their
        parameters, `rivals` and an `extended_scene`. `ValueError` where trials have another shape; `Problem` where
        columns or units cannot be.
        """
        body = given(
            scene=scene,
            ball=ball,
            trials=None if trials is None else texts(trials),
            reading=reading,
            job=calls.id_of(job),
            seed=seed,
        )
        return self._job(await self._line.do(calls.post("start_diagnosis", body, key)))

    async def posterior(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: Measured | None = None,
        *,
        ball: Mapping[str, float] | None = None,
        reading: Mapping[str, Any] | None = None,
        job: AsyncJob | str | None = None,
        sets: Sequence[Sequence[str]] | None = None,
        calibrate: Sequence[str] | None = None,
        prior: Mapping[str, Sequence[float]] | None = None,
        method: str | None = None,
        draws: int | None = None,
        discrepancy: bool | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """What is known of latents and of effects' parameters, as a job: draws from the posterior given a scene and trials, or a
        job's trials (as `diagnose` takes them).

        `sets` of effects are models of their own, weighed by how they predict trials from the others; `[]` is the scene as it is.
        `calibrate` names latents in place of the scene's; `prior` is a mean and a standard deviation by latent; `method` is `smc` or
        `mcmc`.

        The result (`iplw.posterior/1`) has `columns`, draws by name, ready for NumPy or `pandas.DataFrame(result["columns"])`, with `run`
        (which independent run each draw is of), `parameters` with means and quantiles, `converged` and `warnings`. `plan` takes it as its
        `belief`.
        """
        body = given(
            scene=scene,
            ball=ball,
            trials=None if trials is None else texts(trials),
            reading=reading,
            job=calls.id_of(job),
            sets=sets,
            calibrate=calibrate,
            prior=prior,
            method=method,
            draws=draws,
            discrepancy=discrepancy,
            seed=seed,
        )
        return self._job(await self._line.do(calls.post("start_posterior", body, key)))

    async def likelihood(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: Measured | None = None,
        *,
        ball: Mapping[str, float] | None = None,
        reading: Mapping[str, Any] | None = None,
        job: AsyncJob | str | None = None,
        effects: Sequence[str] | None = None,
        calibrate: Sequence[str] | None = None,
        prior: Mapping[str, Sequence[float]] | None = None,
        discrepancy: bool | None = None,
        seed: int | None = None,
        key: str | None = None,
        progress: bool = False,
        timeout: float | None = None,
    ) -> AsyncLikelihood:
        """What `posterior` draws from, for a sampler of your own: emcee, dynesty, a few lines of NumPy.

        Takes what `posterior` takes, of a single set of `effects`, and waits until it is prepared (seconds; a bar with
        `progress`, and as `AsyncJob.wait` until `timeout`). Asked again for the same, a server that still has it answers at once.
        """
        body = given(
            scene=scene,
            ball=ball,
            trials=None if trials is None else texts(trials),
            reading=reading,
            job=calls.id_of(job),
            effects=effects,
            calibrate=calibrate,
            prior=prior,
            discrepancy=discrepancy,
            seed=seed,
        )
        preparing = self._job(await self._line.do(calls.post("start_likelihood", body, key)))
        await preparing.wait(progress, timeout)
        return AsyncLikelihood(self._line, preparing.data)

    async def plan(
        self,
        task: str,
        *,
        belief: Mapping[str, Any] | None = None,
        latents: Mapping[str, float] | None = None,
        effects: Sequence[Mapping[str, Any]] | None = None,
        actions: int | None = None,
        draws: int | None = None,
        perturb: float | None = None,
        exact: int | None = None,
        rollouts: int | None = None,
        seconds: float | None = None,
        engine: str | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Which actions of a task are the likeliest to solve it under what is believed of the world, as a job.

        What is believed: `belief`, a posterior (an `iplw.posterior/1` document); or one world of `latents` and `effects`; or,
        without either, the family's prior. `actions` are looked at, each in up to `draws` worlds and moved by up to `perturb`
        (a share of its range); the best `exact` are those of trying everything, and get probabilities from fresh draws.
        After `rollouts` or `seconds` the answer is what is known by then.

        The result's `actions` are best first, each with `action`, `share`, `probability` and `standard_error`; `complete` says
        whether the best are known for certain.
        """
        body = given(
            task=task,
            belief=belief,
            latents=latents,
            effects=effects,
            actions=actions,
            draws=draws,
            perturb=perturb,
            exact=exact,
            rollouts=rollouts,
            seconds=seconds,
            engine=engine,
            seed=seed,
        )
        return self._job(await self._line.do(calls.post("start_plan", body, key)))

    async def design(
        self,
        task: str,
        *,
        question: Literal["latents", "effects", "success"] | None = None,
        belief: Mapping[str, Any] | None = None,
        sets: Sequence[Sequence[str]] | None = None,
        noise: float | None = None,
        batch: int | None = None,
        costs: Mapping[str, float] | None = None,
        candidates: int | None = None,
        shortlist: int | None = None,
        worlds: int | None = None,
        copies: int | None = None,
        perturb: float | None = None,
        engine: str | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Which experiments would tell the most about a question under what is believed of the world, as a job.

        The `question`: how large `latents` and effects' parameters are, which of the belief's sets of `effects` the world has,
        or whether what is planned for the test tasks solves them, its `success`. What is believed: `belief`, a posterior (an
        `iplw.posterior/1` document); or the family's prior with one of the `sets` of effects, each by names. Positions are
        seen with a standard deviation of `noise`, m; a hand moves every component of an action by up to `perturb`.

        With `costs`, those are chosen that tell most for their cost: of every `trial` (1), of the `setup` of each task of the
        batch (0), and the `budget` that the batch may not exceed.

        The result's `experiments` are the `batch`, in order, each with `task`, `action`, `information` in nats and its
        `standard_error`, what it `adds` to those before it, and its `reason` in words.
        """
        body = given(
            task=task,
            question=question,
            belief=belief,
            sets=sets,
            noise=noise,
            batch=batch,
            costs=costs,
            candidates=candidates,
            shortlist=shortlist,
            worlds=worlds,
            copies=copies,
            perturb=perturb,
            engine=engine,
            seed=seed,
        )
        return self._job(await self._line.do(calls.post("start_design", body, key)))

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
        """Which latent factors a family's performance depends on, as a job; its result's `surface` is an id.

        `factors`: two or three of `density`, `friction`, `restitution` (default: the last two); `points`: design points, 3
        to 5000 (40); `route`: `ideal` (the default, no learning) or `dqn` (a policy trained at every point); `actions`:
        how many are sampled per task.
        """
        body = given(
            task=task, factors=factors, points=points, route=route, actions=actions, seed=seed
        )
        return self._job(await self._line.do(calls.post("find_surface", body, key)))

    async def surfaces(self) -> list[AsyncSurface]:
        """Every surface on the server."""
        return [AsyncSurface(self._line, data) for data in await self._line.items("list_surfaces")]

    async def surface(self, id: str) -> AsyncSurface:
        """The surface with this id."""
        return AsyncSurface(self._line, await self._line.do(calls.get("get_surface", id)))

    async def policies(self) -> list[AsyncPolicy]:
        """Every policy on the server."""
        return [AsyncPolicy(self._line, data) for data in await self._line.items("list_policies")]

    async def policy(self, id: str) -> AsyncPolicy:
        """The policy with this id."""
        return AsyncPolicy(self._line, await self._line.do(calls.get("get_policy", id)))

    async def upload_policy(self, id: str, weights: bytes | str | Path) -> AsyncPolicy:
        """Creates or replaces the policy `id` from safetensors bytes or a file of them; `Problem` if they are damaged."""
        data = weights if isinstance(weights, bytes) else Path(weights).read_bytes()
        await self._line.do(calls.upload(id, data))
        return await self.policy(id)

    async def jobs(self) -> list[AsyncJob]:
        """Every job on the server."""
        return [self._job(data) for data in await self._line.items("list_jobs")]

    async def job(self, id: str) -> AsyncJob:
        """The job with this id."""
        return self._job(await self._line.do(calls.get("get_job", id)))

    async def call(self, op: str, *, key: str | None = None, **args: Any) -> Any:
        """Any operation of the OpenAPI document by its id, with what its path, query and body take: the answer as is.

        Of a list, one page. Repeated after a lost connection only with a `key`. An operation or argument that there
        is not is a `ValueError` that names what there is.
        """
        return await self._line.do(calls.raw(op, args, key))

    async def start(self, op: str, *, key: str | None = None, **args: Any) -> AsyncJob:
        """As `call`, of an operation that starts a job: the job."""
        return self._job(await self._line.do(calls.starting(op, args, key)))

    async def close(self) -> None:
        """Drops the connection and gives the private server back; a second call does nothing."""
        self._line.close()
        if self.server is not None:
            await self._line.run(self._release)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        private = f", private server {self.server.pid}" if self.server else ""
        return f"<iplw.{type(self).__name__} {self.url}{private}>"

    def _job(self, data: dict[str, Any]) -> AsyncJob:
        asks = (data.get("config") or {}).get("real") == "ask_tell"
        return AsyncAsking(self._line, data) if asks else AsyncJob(self._line, data)

    def _release(self) -> None:
        held, self.server = self.server, None
        if held is not None:
            server.release(held)
