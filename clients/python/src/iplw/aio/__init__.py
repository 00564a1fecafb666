"""The client and its handles."""

from .asking import AsyncAsking
from .branch import AsyncBranch
from .client import AsyncClient
from .job import AsyncJob
from .likelihood import AsyncLikelihood
from .policy import AsyncPolicy
from .surface import AsyncSurface
from .world import AsyncWorld

__all__ = ["AsyncAsking", "AsyncBranch", "AsyncClient", "AsyncJob", "AsyncLikelihood", "AsyncPolicy", "AsyncSurface", "AsyncWorld"]
