"""Which pages may connect. OpenEnv has no tokens, and a browser lets any page open a WebSocket to this machine."""

from __future__ import annotations

import ipaddress
import json
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from typing import Any, TypeAlias
from urllib.parse import urlsplit

from starlette.websockets import WebSocketDisconnect

Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
Application: TypeAlias = Callable[[Message, Receive, Send], Awaitable[None]]


class Guard:
    """An application that lets through who is no page, or a page of the server's own, or one that is allowed by name.

    A `Host` that is neither an address, `localhost` nor allowed is refused, too: a name of others may lead here.
    """

    def __init__(self, app: Application, origins: Collection[str] = (), hosts: Collection[str] = ()) -> None:
        self._app, self._origins, self._hosts = app, frozenset(origins), frozenset(hosts)

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
            why = self._refused(headers.get(b"host", ""), headers.get(b"origin"))
            if why is not None:
                await _refuse(scope, receive, send, why)
                return
        try:
            await self._app(scope, receive, send)
        except WebSocketDisconnect:
            # A client that hangs up ends its session; OpenEnv then closes the connection once more, which is no news.
            pass

    def _refused(self, host: str, origin: str | None) -> str | None:
        name = urlsplit(f"//{host}").hostname or ""
        if name != "localhost" and name not in self._hosts and not _is_address(name):
            return f"the server is not called {name!r}; allowed: an address, localhost, or --allow-host {name}"
        if origin is None or origin in self._origins or urlsplit(origin).netloc == host:
            return None
        return f"a page of {origin!r} may not connect; allowed: the server's own, or --allow-origin {origin}"


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


async def _refuse(scope: Message, receive: Receive, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        # Before it is accepted, this is status 403 to who connects.
        await send({"type": "websocket.close", "code": 1008, "reason": why[:120]})
        return
    body = json.dumps({"detail": why}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": body})
