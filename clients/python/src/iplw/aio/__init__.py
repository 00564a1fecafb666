"""The client and its resources."""

from .ask_tell import AsyncAskTellJob
from .branch import AsyncBranch
from .client import AsyncClient
from .control import AsyncControlWorld
from .job import AsyncJob
from .likelihood import AsyncLikelihood
from .policy import AsyncPolicy
from .surface import AsyncSurface
from .world import AsyncWorld

__all__ = [
    "AsyncAskTellJob",
    "AsyncBranch",
    "AsyncClient",
    "AsyncControlWorld",
    "AsyncJob",
    "AsyncLikelihood",
    "AsyncPolicy",
    "AsyncSurface",
    "AsyncWorld",
]
