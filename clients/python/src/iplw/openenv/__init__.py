"""Worlds for OpenEnv: a server that its clients drive, and a typed client.

    python -m iplw.openenv --task bowling --world sim --port 8000

    from iplw.openenv import IplwAction, IplwEnv

    with IplwEnv(base_url="http://127.0.0.1:8000").sync() as env:
        start = env.reset(seed=1)
        result = env.step(IplwAction(action=[0.5, 0.9, 0.3]))
        print(result.observation.valid, result.observation.solved, result.reward, result.done)

Needs `pip install 'iplw[openenv]'`. The files, from the top down; each uses only those below it:

| file | what |
|---|---|
| `__main__`, `server` | the command; the same as an ASGI application for `uvicorn`, which `openenv.yaml` names |
| `app` | the application: OpenEnv's routes over environments of ours |
| `environment` | `reset`, `step`, `state` of one session |
| `client` | the typed client |
| `models` | what goes over the wire: action, observation, state |
| `settings`, `budget`, `guard` | what a server is started with; real interactions of all sessions; who may connect |
"""

try:
    import openenv as _  # noqa: F401
except ImportError as error:
    raise ImportError(f"iplw.openenv needs OpenEnv: pip install 'iplw[openenv]' ({error})") from error

from .app import make_app
from .budget import Budget
from .client import IplwEnv
from .environment import IplwEnvironment
from .models import IplwAction, IplwObservation, IplwState
from .settings import Settings

__all__ = [
    "Budget",
    "IplwAction",
    "IplwEnv",
    "IplwEnvironment",
    "IplwObservation",
    "IplwState",
    "Settings",
    "make_app",
]
