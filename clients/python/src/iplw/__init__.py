"""Python client of iplw: simulated worlds, estimation of latent factors, transfer of policies.

    import gymnasium, iplw
    env = gymnasium.make("iplw/Bowling-v0", world="sim")  # a private server starts and stops by itself

    with iplw.Client() as client:  # or iplw.Client("http://127.0.0.1:8080")
        estimate = client.iplw("bowling", world="bowling-real").wait(progress=True)

    async with iplw.AsyncClient("tcp://127.0.0.1:5555") as client:  # the same methods, awaited
        async with await client.create_world("bowling") as world:
            observation, info = await world.reset(seed=1)

The modules, from the top down; each imports only those below it:

| module | contents |
|---|---|
| `envs`, `vector`, `control_envs`, `sharding`, `video`, `browser`, `registration`, `families` | Gymnasium environments |
| `aio`, `sync` | the client and its resources (worlds, jobs, policies, surfaces, likelihoods): written once, in `aio`; `generate.py` derives `sync` |
| `runner` | the difference between the two: blocking calls in the calling thread or in a thread pool |
| `plot`, `notebook`, `progress` | matplotlib figures; job progress in a notebook or as a tqdm bar |
| `outcomes`, `results`, `trials`, `rows`, `scene`, `display` | responses as objects with HTML display and pandas frames |
| `requests`, `rollout`, `branching`, `film`, `ranking`, `proposal`, `likelihood`, `inputs` | request construction and response parsing, without I/O |
| `connect`, `http`, `zeromq`, `transport` | transports; `codec` and `frames` serialise |
| `request`, `operations` | a request; the table of operations, generated from the OpenAPI document by `generate.py` |
| `server`, `binary`, `errors` | the private server; locating its executable; exceptions |
| `cli` | commands of the program as subprocesses in temporary directories |
| `version`, `__main__` | package version; `python -m iplw` runs the program |
"""

from . import plot
from .aio import (
    AsyncAskTellJob,
    AsyncBranch,
    AsyncClient,
    AsyncControlWorld,
    AsyncJob,
    AsyncLikelihood,
    AsyncPolicy,
    AsyncSurface,
    AsyncWorld,
)
from .branching import BodyState
from .control_envs import ControlEnv, ControlVectorEnv
from .errors import IplwError, JobCancelled, JobFailed, Problem, ServerUnavailable
from .film import Film
from .outcomes import Outcomes
from .proposal import Proposal
from .ranking import Ranked
from .registration import register
from .results import Diagnosis, Estimate, Result, Score, Training
from .rollout import Rollout, Rollouts
from .rows import Rounds, Rows
from .scene import Scene
from .sync import AskTellJob, Branch, Client, ControlWorld, Job, Likelihood, Policy, Surface, World
from .trials import Trials
from .vector import PlacementVectorEnv, make_vec
from .version import package_version
from .video import RecordVideo

__version__ = package_version()

__all__ = [
    "AskTellJob",
    "AsyncAskTellJob",
    "AsyncBranch",
    "AsyncClient",
    "AsyncControlWorld",
    "AsyncJob",
    "AsyncLikelihood",
    "AsyncPolicy",
    "AsyncSurface",
    "AsyncWorld",
    "BodyState",
    "Branch",
    "Client",
    "ControlEnv",
    "ControlVectorEnv",
    "ControlWorld",
    "Diagnosis",
    "Estimate",
    "Film",
    "IplwError",
    "Job",
    "JobCancelled",
    "JobFailed",
    "Likelihood",
    "Outcomes",
    "PlacementVectorEnv",
    "Policy",
    "Problem",
    "Proposal",
    "Ranked",
    "RecordVideo",
    "Result",
    "Rollout",
    "Rollouts",
    "Rounds",
    "Rows",
    "Scene",
    "Score",
    "ServerUnavailable",
    "Surface",
    "Training",
    "Trials",
    "World",
    "make_vec",
    "plot",
    "register",
]

register()
