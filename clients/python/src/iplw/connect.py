"""Chooses the transport for an address."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import urlsplit

from .http import Http
from .transport import Transport


def connect(
    url: str,
    timeout: float,
    advice: Callable[[], str] | None = None,
    token: str | None = None,
    verify: bool | str = True,
) -> Transport:
    """The transport for an address; nothing is sent yet. The default scheme is HTTP; `ValueError` for a malformed address.

    `advice`: returns a hint for the message of a failed request. `token`: authentication. `verify`: False, or the file of
    trusted certificates, for `https://`.
    """
    full = url if "://" in url else "http://" + url
    if not _is_valid(full):
        raise ValueError(
            f"url is {url!r}; allowed: an address like http://127.0.0.1:8080, tcp://127.0.0.1:5555 or ipc:///tmp/iplw"
        )
    if full.startswith(("tcp:", "ipc:")):
        # pyzmq is an optional dependency.
        from .zeromq import ZeroMq

        return ZeroMq(full, timeout, advice, token)
    return Http(full, timeout, advice, token, verify)


def _is_valid(url: str) -> bool:
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError:
        return False
    if parts.scheme == "ipc":
        return len(url) > len("ipc://")
    if parts.scheme == "tcp":
        return bool(parts.hostname) and port is not None
    return parts.scheme in ("http", "https") and bool(parts.hostname)
