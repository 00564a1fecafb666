# Made by `generate.py` from `aio/__init__.py`; change that.
"""The client and its handles."""

from .asking import Asking
from .branch import Branch
from .client import Client
from .job import Job
from .likelihood import Likelihood
from .policy import Policy
from .surface import Surface
from .world import World

__all__ = ["Asking", "Branch", "Client", "Job", "Likelihood", "Policy", "Surface", "World"]
