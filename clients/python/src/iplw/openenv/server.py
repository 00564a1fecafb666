"""ASGI application for `uvicorn iplw.openenv.server:app`, named in `openenv.yaml`.

The environment variable IPLW_OPENENV holds arguments of `python -m iplw.openenv`: `--world real --budget 100`.
"""

from __future__ import annotations

import os
import shlex

from .app import make_app
from .settings import read

app = make_app(read(shlex.split(os.environ.get("IPLW_OPENENV", "")))[1])
