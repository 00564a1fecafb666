"""Serves worlds to OpenEnv clients: `python -m iplw.openenv --task bowling --world sim --port 8000`."""

from __future__ import annotations

import socket
import sys
from collections.abc import Sequence

import uvicorn

from .. import IplwError
from .app import make_app
from .settings import read


def main(arguments: Sequence[str] | None = None) -> int:
    """Serves until it is stopped; exit code 2 for invalid settings."""
    options, settings = read(arguments)
    try:
        app = make_app(settings)
        listener = socket.create_server((options.host, options.port))
    except (IplwError, ValueError, OSError) as error:
        print(f"iplw.openenv: {error}", file=sys.stderr)
        return 2
    host, port = listener.getsockname()[:2]
    print(f"listening on http://{host}:{port}", flush=True)
    uvicorn.Server(uvicorn.Config(app, log_level="warning")).run(sockets=[listener])
    return 0


if __name__ == "__main__":
    sys.exit(main())
