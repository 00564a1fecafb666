"""Restricts which web pages may connect: OpenEnv has no tokens, and browsers let any page open a WebSocket to localhost."""

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


class OriginMiddleware:
    """ASGI middleware that accepts clients without an `Origin`, pages of this server, and listed origins.

    A `Host` that is not an IP address, `localhost` or listed is rejected, to prevent DNS rebinding.
    """

    def __init__(self, app: Application, origins: Collection[str] = (), hosts: Collection[str] = ()) -> None:
        self._app, self._origins, self._hosts = app, frozenset(origins), frozenset(hosts)

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
            reason = self._rejection(headers.get(b"host", ""), headers.get(b"origin"))
            if reason is not None:
                await _reject(scope, receive, send, reason)
                return
        try:
            await self._app(scope, receive, send)
        except WebSocketDisconnect:
            # The client has disconnected; OpenEnv then closes the connection a second time.
            pass

    def _rejection(self, host: str, origin: str | None) -> str | None:
        name = urlsplit(f"//{host}").hostname or ""
        if name != "localhost" and name not in self._hosts and not _is_address(name):
            return f"unknown host {name!r}; allowed: an address, localhost, or --allow-host {name}"
        if origin is None or origin in self._origins or urlsplit(origin).netloc == host:
            return None
        return f"origin {origin!r} is not allowed; allowed: pages of this server, or --allow-origin {origin}"


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


async def _reject(scope: Message, receive: Receive, send: Send, reason: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        # Closing before accepting gives status 403.
        await send({"type": "websocket.close", "code": 1008, "reason": reason[:120]})
        return
    body = json.dumps({"detail": reason}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": body})
