"""The client and its resources."""

from .ask_tell import AsyncAskTellJob
from .branch import AsyncBranch
from .client import AsyncClient
from .job import AsyncJob
from .likelihood import AsyncLikelihood
from .policy import AsyncPolicy
from .surface import AsyncSurface
from .world import AsyncWorld

__all__ = ["AsyncAskTellJob", "AsyncBranch", "AsyncClient", "AsyncJob", "AsyncLikelihood", "AsyncPolicy", "AsyncSurface", "AsyncWorld"]
