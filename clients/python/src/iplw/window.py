"""The server's page, opened where a world is watched: `render_mode="human"`."""

from __future__ import annotations

import os
import sys
import webbrowser
from urllib.parse import quote

from .sync import Client

#: One of them says that a browser has somewhere to appear.
_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


def page(client: Client) -> str:
    """The address of the server's page."""
    url = client.server.address("http") if client.server else client.url
    if not url.startswith(("http://", "https://")):
        raise ValueError(
            f"render_mode is 'human' and url is {url!r}; allowed: the server's http address, where its page is"
        )
    return url.rstrip("/")


def show(page: str, world: str) -> None:
    """Opens the page at a world; where there is no browser, says what to open."""
    where = f"{page}/#/live/{quote(world, safe='')}"
    if not _opened(where):
        print(f"watch it at {where}", file=sys.stderr, flush=True)


def _opened(where: str) -> bool:
    # Without a screen, a browser for the terminal would take it over.
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in _SCREENS):
        return False
    try:
        return webbrowser.open(where)
    except webbrowser.Error:
        return False
