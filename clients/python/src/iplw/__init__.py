"""Client of iplw: worlds to act in, latent factors to estimate, policies to transfer.

    import gymnasium, iplw
    env = gymnasium.make("iplw/Bowling-v0", world="sim")  # a private server starts and stops by itself

    with iplw.Client() as client:  # or iplw.Client("http://127.0.0.1:8080")
        found = client.iplw("bowling", world="bowling-real").wait(progress=True)

    async with iplw.AsyncClient("tcp://127.0.0.1:5555") as client:  # the same methods, awaited
        async with await client.create_world("bowling") as world:
            observation, info = await world.reset(seed=1)

The files, from the top down; each uses only those below it:

| file | what |
|---|---|
| `envs`, `vector`, `fleet`, `video`, `registration`, `families` | Gymnasium's environments |
| `aio`, `sync` | the client and its handles on worlds, jobs, policies, surfaces, likelihoods: written once, in `aio`; `generate.py` makes `sync` of it |
| `runner` | the difference between the two: who does what blocks |
| `plot`, `live` | figures by matplotlib; a job as it goes on, in a notebook |
| `outcomes`, `results`, `trials`, `rows`, `scene`, `show` | what a notebook shows, and pandas takes, of what the server tells |
| `calls`, `rollout`, `branching`, `film`, `ranked`, `proposal`, `likelihood`, `measured`, `bar` | what is asked, and what answers mean; nothing here waits |
| `connect`, `http`, `zeromq`, `transport` | how a call goes to the server and back; `codec` and `frames` write it down |
| `call`, `operations` | a call; the table of operations, which `generate.py` makes of the OpenAPI document |
| `server`, `binary`, `errors` | a private server; where its program is; what all of them raise |
| `version`, `__main__` | which version this is; `python -m iplw` runs the program |
"""

from . import plot
from .aio import AsyncAsking, AsyncBranch, AsyncClient, AsyncJob, AsyncLikelihood, AsyncPolicy, AsyncSurface, AsyncWorld
from .branching import BodyState
from .errors import IplwError, JobCancelled, JobFailed, Problem, ServerUnavailable
from .film import Film
from .outcomes import Outcomes
from .proposal import Proposal
from .ranked import Ranked
from .registration import register
from .results import Diagnosis, Estimate, Result, Score, Training
from .rollout import Rollout, Rollouts
from .rows import Rounds, Rows
from .scene import Scene
from .sync import Asking, Branch, Client, Job, Likelihood, Policy, Surface, World
from .trials import Trials
from .vector import PlacementVectorEnv, make_vec
from .version import own_version
from .video import RecordVideo

__version__ = own_version()

__all__ = [
    "Asking",
    "AsyncAsking",
    "AsyncBranch",
    "AsyncClient",
    "AsyncJob",
    "AsyncLikelihood",
    "AsyncPolicy",
    "AsyncSurface",
    "AsyncWorld",
    "BodyState",
    "Branch",
    "Client",
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
