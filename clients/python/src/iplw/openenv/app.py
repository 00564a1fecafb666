"""The application: OpenEnv's routes (`/ws`, `/reset`, `/step`, `/state`, `/schema`, ...) over sessions of ours."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse
from openenv.core.env_server.http_server import create_app
from openenv.core.env_server.types import ConcurrencyConfig

from .. import Client, Problem, ServerUnavailable
from ..envs import settings_of
from .budget import Budget
from .environment import IplwEnvironment
from .guard import Guard
from .models import IplwAction, IplwObservation
from .settings import Settings

#: What a session raises -> the status over HTTP; over the WebSocket all are messages.
STATUS: dict[type[Exception], int] = {ValueError: 422, RuntimeError: 409, PermissionError: 429, ServerUnavailable: 503}


def make_app(settings: Settings, client: Client | None = None, budget: Budget | None = None) -> Guard:
    """An ASGI application that serves these worlds; `uvicorn.run(make_app(Settings()))`.

    Makes one world to see that it can, so that a task or setting that there is not is a `Problem` or `ValueError` here.
    `client`: a connection to the iplw server, whose caller closes it; without one it is made, and lasts as long as the
    process. `budget` counts real interactions; by default that of the settings.
    """
    client = client or Client(settings.url)
    client.create_world(**settings_of(settings.task, settings.world)).close()
    app = create_app(
        partial(IplwEnvironment, client, settings, budget or Budget(settings.budget)),
        IplwAction,
        IplwObservation,
        env_name="iplw",
        concurrency_config=ConcurrencyConfig(max_concurrent_envs=settings.sessions, session_timeout=settings.idle),
    )
    for kind, status in STATUS.items():
        app.add_exception_handler(kind, _teller(status))
    app.add_exception_handler(Problem, _teller(None))
    return Guard(app, settings.origins, settings.hosts)


def _teller(status: int | None) -> Callable[[Request, Any], JSONResponse]:
    """What tells an exception over HTTP, where OpenEnv would say no more than `Internal Server Error`."""

    def tell(_: Request, error: Any) -> JSONResponse:
        return JSONResponse({"detail": str(error)}, error.status if status is None else status)

    return tell
