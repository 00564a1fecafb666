"""Opens the server's web page at a world: `render_mode="human"`."""

from __future__ import annotations

import os
import sys
import webbrowser
from urllib.parse import quote

from .sync import Client

#: Environment variables that indicate a display.
_DISPLAY_VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")


def page_url(client: Client) -> str:
    """The address of the server's web page."""
    url = client.server.address("http") if client.server else client.url
    if not url.startswith(("http://", "https://")):
        raise ValueError(
            f"render_mode is 'human' and url is {url!r}; allowed: the server's http address, which serves the web page"
        )
    return url.rstrip("/")


def open_world(page: str, world: str) -> None:
    """Opens the page at a world; prints its address if there is no browser."""
    url = f"{page}/#/live/{quote(world, safe='')}"
    if not _open(url):
        print(f"watch it at {url}", file=sys.stderr, flush=True)


def _open(url: str) -> bool:
    # Without a display, a text-mode browser would take over the terminal.
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in _DISPLAY_VARIABLES):
        return False
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False
