"""The application: OpenEnv's routes (`/ws`, `/reset`, `/step`, `/state`, `/schema`, ...) over our environments."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse
from openenv.core.env_server.http_server import create_app
from openenv.core.env_server.types import ConcurrencyConfig

from .. import Client, Problem, ServerUnavailable
from ..envs import world_settings
from .budget import Budget
from .environment import IplwEnvironment
from .middleware import OriginMiddleware
from .models import IplwAction, IplwObservation
from .settings import Settings

#: Exception of a session -> HTTP status; over the WebSocket all are messages.
STATUS_BY_ERROR: dict[type[Exception], int] = {ValueError: 422, RuntimeError: 409, PermissionError: 429, ServerUnavailable: 503}


def make_app(settings: Settings, client: Client | None = None, budget: Budget | None = None) -> OriginMiddleware:
    """An ASGI application that serves these worlds; `uvicorn.run(make_app(Settings()))`.

    Creates one world to validate the settings: an invalid task or setting raises `Problem` or `ValueError` here. `client`: a
    connection to the iplw server, closed by the caller; by default one is created for the lifetime of the process. `budget`:
    counter of real interactions; by default that of the settings.
    """
    client = client or Client(settings.url)
    client.create_world(**world_settings(settings.task, settings.world)).close()
    app = create_app(
        partial(IplwEnvironment, client, settings, budget or Budget(settings.budget)),
        IplwAction,
        IplwObservation,
        env_name="iplw",
        concurrency_config=ConcurrencyConfig(max_concurrent_envs=settings.sessions, session_timeout=settings.idle),
    )
    for kind, status in STATUS_BY_ERROR.items():
        app.add_exception_handler(kind, _error_handler(status))
    app.add_exception_handler(Problem, _error_handler(None))
    return OriginMiddleware(app, settings.origins, settings.hosts)


def _error_handler(status: int | None) -> Callable[[Request, Any], JSONResponse]:
    """An exception handler that returns the message; OpenEnv would return `Internal Server Error`."""

    def handle(_: Request, error: Any) -> JSONResponse:
        return JSONResponse({"detail": str(error)}, error.status if status is None else status)

    return handle
