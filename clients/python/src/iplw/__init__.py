"""Client of iplw: worlds to act in, latent factors to estimate, policies to transfer.

    import gymnasium, iplw
    env = gymnasium.make("iplw/Bowling-v0", world="sim")  # a private server starts and stops by itself

    with iplw.Client() as client:  # or iplw.Client("http://127.0.0.1:8080")
        found = client.iplw("bowling", world="bowling-real").wait(progress=True)

The files: `client` is the way in; `world`, `job`, `policy` are handles on what
the server keeps (`handle` is what they share), `asking` a job that asks you what to measure; `envs` has
the Gymnasium environments; `server` runs a private server; `http` speaks to one; `errors` is what they raise.
"""

from .aio import AsyncClient, AsyncJob, AsyncPolicy, AsyncWorld
from .asking import Asking, Proposal
from .client import Client
from .errors import IplwError, JobCancelled, JobFailed, Problem, ServerUnavailable
from .job import Job
from .policy import Policy, Ranked
from .registration import register
from .rollout import Rollout, Rollouts
from .vector import PlacementVectorEnv, make_vec
from .world import World

__version__ = "0.1.0"

__all__ = [
    "Asking",
    "AsyncClient",
    "AsyncJob",
    "AsyncPolicy",
    "AsyncWorld",
    "Client",
    "IplwError",
    "Job",
    "JobCancelled",
    "JobFailed",
    "PlacementVectorEnv",
    "Policy",
    "Problem",
    "Proposal",
    "Ranked",
    "Rollout",
    "Rollouts",
    "ServerUnavailable",
    "World",
    "make_vec",
    "register",
]

register()
