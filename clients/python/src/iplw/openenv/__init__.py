"""OpenEnv server of worlds, with a typed client.

    python -m iplw.openenv --task bowling --world sim --port 8000

    from iplw.openenv import IplwAction, IplwEnv

    with IplwEnv(base_url="http://127.0.0.1:8000").sync() as env:
        start = env.reset(seed=1)
        result = env.step(IplwAction(action=[0.5, 0.9, 0.3]))
        print(result.observation.valid, result.observation.solved, result.reward, result.done)

Requires `pip install 'iplw[openenv]'`. The modules, from the top down; each imports only those below it:

| module | contents |
|---|---|
| `__main__`, `server` | the command; the ASGI application for `uvicorn`, named in `openenv.yaml` |
| `app` | the application: OpenEnv's routes over our environments |
| `environment` | `reset`, `step`, `state` of one session |
| `client` | the typed client |
| `models` | action, observation and state on the wire |
| `settings`, `budget`, `middleware` | server settings; budget of real interactions over all sessions; origin checks |
"""

try:
    import openenv as _  # noqa: F401
except ImportError as error:
    raise ImportError(f"iplw.openenv requires OpenEnv: pip install 'iplw[openenv]' ({error})") from error

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
