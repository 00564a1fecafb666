"""The client: a connection to a server, with methods that create resources."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, overload

from typing_extensions import Self

from .. import requests, server
from ..request import drop_none
from ..connect import connect
from ..inputs import TrialsLike, trial_texts
from ..rows import Rows
from ..runner import AsyncRunner
from ..scene import Scene
from .ask_tell import AsyncAskTellJob
from .control import AsyncControlWorld
from .job import AsyncJob
from .likelihood import AsyncLikelihood
from .connection import AsyncConnection
from .policy import AsyncPolicy
from .surface import AsyncSurface
from .world import AsyncWorld

#: Address of a private server -> scheme.
PRIVATE = {None: "http", "private": "http", "tcp://private": "tcp"}


class AsyncClient:
    """A connection to an iplw server; also a context manager.

    - `url`: `http://host:port`, or `tcp://host:port` or `ipc://path` for ZeroMQ, which requires `pip install 'iplw[zmq]'`.
      Default: IPLW_URL, else a private server, which all such clients of this process share and which stops when the last of
      them closes or the process ends. `private` is always a private server; `tcp://private` uses ZeroMQ.
    - `token`: for a server with authentication; default: IPLW_TOKEN.
    - `verify`: False, or the file of trusted certificates, for `https://`.
    - `timeout`: for each request, s; batches get more by their size.
    - `collections`: of task families that a private server loads, `levels` or `phyre`; other servers have their own.

    Requests that only read or delete, or that carry a `key`, are retried after a lost connection, others never.
    """

    def __init__(
        self,
        url: str | None = None,
        *,
        token: str | None = None,
        verify: bool | str = True,
        timeout: float = 30.0,
        binary: str | os.PathLike[str] | None = None,
        collections: Sequence[str] = (),
        concurrency: int = 32,  # async
    ) -> None:
        """`concurrency`: maximum number of concurrent requests; further requests wait."""  # async
        #: The private server, if used.
        self.server: server.PrivateServer | None = None
        runner = AsyncRunner(concurrency)  # async
        # sync: runner = Runner()
        url = url if url is not None else os.environ.get("IPLW_URL") or None
        private = PRIVATE.get(url)
        if isinstance(collections, str):
            raise ValueError(f"collections is {collections!r}; allowed: a list of names, such as [{collections!r}]")
        if private is not None:
            self.server = server.acquire(binary, tuple(sorted(collections)))
        try:
            address = self.server.address(private) if self.server and private else str(url)
            advice = self.server.advice if self.server else None
            auth_token = None if private else token if token is not None else os.environ.get("IPLW_TOKEN") or None
            self._connection = AsyncConnection(connect(address, timeout, advice, auth_token, verify), runner)
        except BaseException:
            self._release()
            raise

    @property
    def url(self) -> str:
        """The server's address."""
        return self._connection.url

    async def worlds(self) -> list[AsyncWorld]:
        """All worlds on the server."""
        return [AsyncWorld(self._connection, data) for data in await self._connection.items("list_worlds")]

    async def world(self, id: str) -> AsyncWorld:
        """The world with this id; predefined: `bowling-sim`, `bowling-real`, ..."""
        return AsyncWorld(self._connection, await self._connection.do(requests.get("get_world", id)))

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
        max_attempts: int | None = None,
        sealed: bool | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncWorld:
        """Creates a world of a task family (`bowling`), a task (`bowling:017`) or a custom scene.

        - `scene`: an `iplw.scene/1` document with `action` and `goal`, instead of a task.
        - `kind`: `sim` (default), or `real`: latents are hidden, valid attempts counted.
        - `engine`: `auto` (default), `lanes`, `rapier` or `gpu`.
        - `latents`: density (kg/m^2), friction, restitution; default: the family's prior mean (sim) or its standard truth
          (real).
        - `effects`: physics beyond gravity and contact, `[{"name": "wind", "parameters": {"ax": 0.5}}]`, in SI;
          `damping`: a shorthand for one of them, the fraction of velocity that remains after 1 s, in (0, 1].
        - `noise`: standard deviation of observations, m; `budget`: maximum number of valid attempts. Real worlds only.
        - `max_attempts`: valid attempts in an episode (1). With more, an episode continues with the same task until it is solved,
          with its AUCCESS as reward (1 at the first attempt), or all attempts have failed.
        - `sealed`: whether latents and effects are secret; default: by `kind`. A real world of a family is not sealed only with
          latents and effects of your own.
        - `seed`: of resets without a seed, of noise, and of hidden numbers that a family draws.

        With an idempotency `key`, repeated calls create one world. Close it, or use it as a context manager; otherwise it is
        deleted after a long idle time. `Problem` if a setting is not allowed.
        """
        body = drop_none(
            task=task,
            scene=scene,
            kind=kind,
            engine=engine,
            latents=latents,
            effects=effects,
            damping=damping,
            noise=noise,
            budget=budget,
            max_attempts=max_attempts,
            sealed=sealed,
            seed=seed,
        )
        return AsyncWorld(self._connection, await self._connection.do(requests.post("create_world", body, key)), scene)

    async def control_tasks(self) -> Rows:
        """The built-in control tasks: name, about, times, actions, observations, joints, scene."""
        return Rows((await self._connection.do(requests.post("list_control_tasks", {})))["tasks"])

    async def create_control_world(
        self,
        task: str | None = None,
        *,
        definition: Mapping[str, Any] | None = None,
        kind: str | None = None,
        count: int | None = None,
        reward: str | None = None,
        physics: Mapping[str, Any] | None = None,
        seed: int | None = None,
    ) -> AsyncControlWorld:
        """Creates environments of a control task: a mechanism that is driven in many steps.

        - `task`: a built-in one (`pendulum_swing_up`), or a `definition`: an `iplw.control/1` document.
        - `kind`: `sim` (default), or `real`: with the task's hidden physics.
        - `count`: number of environments (1); `reward`: `dense` (default) or `sparse`.
        - `physics`: `effects` and `noise` of a simulated world, as for `set_physics`.

        The world is deleted after a long idle time, and ends with the server. `Problem` if a setting is not allowed.
        """
        body = drop_none(
            task=task, definition=definition, kind=kind, count=count, reward=reward, physics=physics, seed=seed
        )
        return AsyncControlWorld(self._connection, await self._connection.do(requests.post("create_control_world", body)))

    async def tasks(self) -> Rows:
        """The task families: name, about, number of tasks, split, action space."""
        return Rows(await self._connection.items("list_families"))

    async def family(self, name: str) -> dict[str, Any]:
        """One family with the id, split and certificate of each of its tasks."""
        family = await self._connection.do(requests.post("list_tasks", {"family": name, "limit": 1}))
        family["tasks"] = Rows(await self._connection.items("list_tasks", family=name))
        return family

    async def task(self, id: str) -> dict[str, Any]:
        """One task, `bowling:017`: its split, scene and certificate."""
        task = await self._connection.do(requests.task(id))
        return {**task, "scene": Scene(task["scene"])}

    async def task_ids(self, family: str, split: str | None = None) -> list[str]:
        """Ids of a family's tasks, all or those of one split, in order."""
        tasks = await self._connection.items("list_tasks", family=family)
        return [str(task["id"]) for task in tasks if split is None or task["split"] == split]

    @overload
    async def iplw(
        self,
        task: str | None = None,
        *,
        scene: Mapping[str, Any] | None = None,
        prior: Mapping[str, Sequence[float]] | None = None,
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
    ) -> AsyncAskTellJob: ...
    @overload
    async def iplw(
        self,
        task: str | None = None,
        *,
        scene: Mapping[str, Any] | None = None,
        prior: Mapping[str, Sequence[float]] | None = None,
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
        task: str | None = None,
        *,
        scene: Mapping[str, Any] | None = None,
        prior: Mapping[str, Sequence[float]] | None = None,
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
        """The workflow: explore, measure in the real world, estimate latents. As a job.

        `scene` is a rig of your own instead of a `task`: an `iplw.scene/1` document with an action space and `calibrate`, no goal;
        `prior`: mean and standard deviation of latents, `{"friction": [0.4, 0.2]}`.

        `world` is a real world on the server, which counts interactions; `real` describes one instead: `{"damping": 0.8}`;
        with `real="ask_tell"` the caller carries out the experiments. `surface` says which latents matter; `fit` names effect
        parameters to estimate as well: `["linear_drag.c"]`. With an idempotency `key`, repeated calls start one job.

        - `strategy`: selects actions: `collisions`, `rolling`, `random`, `mixed` (default), `gradient`, `informative`; or, from
          posterior samples in each round, `probing` (maximises information about latents and parameters) or `success`
          (maximises information about whether plans succeed); these take about a minute for each round.
        - `residual`: `trajectory` (default), simulated from start to end; or `shooting`, simulated in segments from observed
          states, which is robust to noise.
        - `rounds`: maximum number of rounds (5); `actions`: real interactions in a round (10); `budget`: maximum number of
          interactions; `samples`: candidates in each iteration of the search.

        The result has `latents`: rows of `name`, `value`, `ci95` and `identifiable`, density in kg/m^2; `real_interactions`; and
        `fit`, whether the simulation can reproduce the measured trials. If it cannot, `diagnose(job=...)` names what it lacks.
        """
        body = drop_none(
            task=task,
            scene=scene,
            prior=prior,
            world=requests.id_of(world),
            real=real,
            surface=requests.id_of(surface),
            strategy=strategy,
            residual=residual,
            fit=fit,
            rounds=rounds,
            actions=actions,
            samples=samples,
            seed=seed,
            budget=budget,
        )
        return self._job(await self._connection.do(requests.post("start_iplw", body, key)))

    async def train(
        self,
        task: str,
        *,
        training: str | None = None,
        posterior: Mapping[str, Any] | None = None,
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

        - `training`: `fixed` (the given latents) or `randomised` (latents sampled for each rollout).
        - `posterior`: a posterior (an `iplw.posterior/2` document) whose samples label the actions; instead of `training`,
          `latents` and `effects`.
        - `latents`: density (kg/m^2), friction, restitution; default: the family's prior mean. `effects`: of the simulation,
          in SI.
        - `preset`: `paper`, a fixed number of `batches`; or `saturating`, until AUCCESS on validation tasks in the same
          simulation stops increasing; the best weights are kept and the result has `validation`.
        - `validations`: number of evaluations on validation tasks.
        - `batches`: updates of `batch_size` examples; defaults: the family's.
        """
        body = drop_none(
            task=task,
            training=training,
            posterior=posterior,
            latents=latents,
            effects=effects,
            preset=preset,
            batches=batches,
            batch_size=batch_size,
            validations=validations,
            seed=seed,
        )
        return self._job(await self._connection.do(requests.post("train_policy", body, key)))

    async def diagnose(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: TrialsLike | None = None,
        *,
        ball: Mapping[str, float] | None = None,
        reading: Mapping[str, Any] | None = None,
        job: AsyncJob | str | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Identifies missing effects of a simulation, as a job, from a scene and trials or from a job's trials.

        - `trials`: a file (path or text), a pandas frame, or a list of arrays (n, 3) of t (s), x and y (m), one for each trial;
          or lists and mappings of files and frames. Column names of common tracking programs are recognised for one body.
        - `reading`: units of the columns: `{"fps": 240, "metres_per_pixel": 0.002, "y_down": True}`.
        - `ball`: replaces the scene for a single ball: `{"radius": 0.02, "floor": 0.0}`, m; `mass` in kg, `gravity` in m/s^2.

        The result has `verdict` (`none`, `named`, `ambiguous`, `unknown`, `insufficient_data`), `effects` with their
        parameters, `rivals` and an `extended_scene`. `ValueError` for trials of another shape; `Problem` for invalid columns or
        implausible units.
        """
        body = drop_none(
            scene=scene,
            ball=ball,
            trials=None if trials is None else trial_texts(trials),
            reading=reading,
            job=requests.id_of(job),
            seed=seed,
        )
        return self._job(await self._connection.do(requests.post("start_diagnosis", body, key)))

    async def posterior(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: TrialsLike | None = None,
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
        sample_discrepancy: bool | None = None,
        seed: int | None = None,
        key: str | None = None,
    ) -> AsyncJob:
        """Samples the posterior of latents and effect parameters, as a job, from a scene and trials or from a job's trials (see
        `diagnose`).

        `sets` of effects are separate models, weighted by held-out prediction; `[]` is the scene without effects. `calibrate`
        names latents to estimate instead of the scene's values; `prior` maps latents to mean and standard deviation; `method`
        is `smc` or `mcmc`. `sample_discrepancy` samples a likely discrepancy field with the parameters: wider, more honest
        intervals, for minutes instead of seconds.

        The result (`iplw.posterior/2`) has `columns`, draws by name, for NumPy or `pandas.DataFrame(result["columns"])`, with
        `run` (the independent run of each draw), `parameters` with means and quantiles, `converged` and `warnings`. `plan`
        accepts it as `posterior`.
        """
        body = drop_none(
            scene=scene,
            ball=ball,
            trials=None if trials is None else trial_texts(trials),
            reading=reading,
            job=requests.id_of(job),
            sets=sets,
            calibrate=calibrate,
            prior=prior,
            method=method,
            draws=draws,
            discrepancy=discrepancy,
            sample_discrepancy=sample_discrepancy,
            seed=seed,
        )
        return self._job(await self._connection.do(requests.post("start_posterior", body, key)))

    async def likelihood(
        self,
        scene: Mapping[str, Any] | None = None,
        trials: TrialsLike | None = None,
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
        """The target density of `posterior`, for any sampler: emcee, dynesty, a few lines of NumPy.

        Arguments as for `posterior`, with a single set of `effects`. Waits until the likelihood is prepared (seconds; `progress`
        and `timeout` as for `AsyncJob.wait`). The server may return a cached likelihood for the same arguments.
        """
        body = drop_none(
            scene=scene,
            ball=ball,
            trials=None if trials is None else trial_texts(trials),
            reading=reading,
            job=requests.id_of(job),
            effects=effects,
            calibrate=calibrate,
            prior=prior,
            discrepancy=discrepancy,
            seed=seed,
        )
        preparing = self._job(await self._connection.do(requests.post("start_likelihood", body, key)))
        await preparing.wait(progress, timeout)
        return AsyncLikelihood(self._connection, preparing.data)

    async def plan(
        self,
        task: str,
        *,
        posterior: Mapping[str, Any] | None = None,
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
        """Ranks actions of a task by their probability of success under a posterior, as a job.

        The distribution of worlds is `posterior`, a posterior (an `iplw.posterior/2` document); or one world of `latents` and
        `effects`; or the family's prior. `actions` candidates are simulated, each in up to `draws` worlds and perturbed by up
        to `perturb` (a share of its range); the best `exact` are those of an exhaustive search and get probabilities from fresh
        draws. After `rollouts` or `seconds` the job returns its current ranking.

        The result's `actions` are best first, each with `action`, `share`, `probability` and `standard_error`; `complete` says
        whether the search has finished.
        """
        body = drop_none(
            task=task,
            posterior=posterior,
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
        return self._job(await self._connection.do(requests.post("start_plan", body, key)))

    async def design(
        self,
        task: str,
        *,
        question: Literal["latents", "effects", "success"] | None = None,
        posterior: Mapping[str, Any] | None = None,
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
        """Chooses experiments by expected information gain under a posterior, as a job.

        `question`: the values of `latents` and effect parameters; which of the sets of `effects` is true; or the `success` of the
        plans for the test tasks. The distribution of worlds is `posterior`, a posterior (an `iplw.posterior/2` document); or the
        family's prior with one of the `sets` of effects. `noise`: standard deviation of observed positions, m; `perturb`: maximum
        actuation error of each action component.

        `costs` maximises information per cost: of every `trial` (1), of the `setup` of each task in the batch (0), with a
        maximum `budget` for the batch.

        The result's `experiments` are the `batch`, in order, each with `task`, `action`, `information` in nats with its
        `standard_error`, its gain over those before it (`adds`), and its `reason`.
        """
        body = drop_none(
            task=task,
            question=question,
            posterior=posterior,
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
        return self._job(await self._connection.do(requests.post("start_design", body, key)))

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
        """Measures how a family's performance depends on latent factors, as a job; its result's `surface` is an id.

        `factors`: two or three of `density`, `friction`, `restitution` (default: the last two); `points`: design points, 3
        to 5000 (40); `route`: `ideal` (default, without learning) or `dqn` (a policy trained at every point); `actions`:
        samples for each task.
        """
        body = drop_none(
            task=task, factors=factors, points=points, route=route, actions=actions, seed=seed
        )
        return self._job(await self._connection.do(requests.post("find_surface", body, key)))

    async def surfaces(self) -> list[AsyncSurface]:
        """All surfaces on the server."""
        return [AsyncSurface(self._connection, data) for data in await self._connection.items("list_surfaces")]

    async def surface(self, id: str) -> AsyncSurface:
        """The surface with this id."""
        return AsyncSurface(self._connection, await self._connection.do(requests.get("get_surface", id)))

    async def policies(self) -> list[AsyncPolicy]:
        """All policies on the server."""
        return [AsyncPolicy(self._connection, data) for data in await self._connection.items("list_policies")]

    async def policy(self, id: str) -> AsyncPolicy:
        """The policy with this id."""
        return AsyncPolicy(self._connection, await self._connection.do(requests.get("get_policy", id)))

    async def upload_policy(self, id: str, weights: bytes | str | Path) -> AsyncPolicy:
        """Creates or replaces the policy `id` from safetensors bytes or a file; `Problem` if they are invalid."""
        data = weights if isinstance(weights, bytes) else Path(weights).read_bytes()
        await self._connection.do(requests.upload(id, data))
        return await self.policy(id)

    async def jobs(self) -> list[AsyncJob]:
        """All jobs on the server."""
        return [self._job(data) for data in await self._connection.items("list_jobs")]

    async def job(self, id: str) -> AsyncJob:
        """The job with this id."""
        return self._job(await self._connection.do(requests.get("get_job", id)))

    async def call(self, op: str, *, key: str | None = None, **args: Any) -> Any:
        """Calls any operation of the OpenAPI document by its id, with its path, query and body arguments; returns the raw
        response.

        A list operation returns one page. Retried after a lost connection only with a `key`. `ValueError` for an unknown
        operation or argument.
        """
        return await self._connection.do(requests.any_operation(op, args, key))

    async def start(self, op: str, *, key: str | None = None, **args: Any) -> AsyncJob:
        """As `call`, for an operation that starts a job; returns the job."""
        return self._job(await self._connection.do(requests.job_operation(op, args, key)))

    async def close(self) -> None:
        """Closes the connection and releases the private server; idempotent."""
        self._connection.close()
        if self.server is not None:
            await self._connection.run(self._release)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __repr__(self) -> str:
        private = f", private server {self.server.pid}" if self.server else ""
        return f"<iplw.{type(self).__name__} {self.url}{private}>"

    def _job(self, data: dict[str, Any]) -> AsyncJob:
        is_ask_tell = (data.get("config") or {}).get("real") == "ask_tell"
        return AsyncAskTellJob(self._connection, data) if is_ask_tell else AsyncJob(self._connection, data)

    def _release(self) -> None:
        server_handle, self.server = self.server, None
        if server_handle is not None:
            server.release(server_handle)
