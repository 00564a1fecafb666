"""The application for `uvicorn iplw.openenv.server:app`, as `openenv.yaml` names it.

IPLW_OPENENV in the environment has the arguments of `python -m iplw.openenv`: `--world real --budget 100`.
"""

from __future__ import annotations

import os
import shlex

from .app import make_app
from .settings import read

app = make_app(read(shlex.split(os.environ.get("IPLW_OPENENV", "")))[1])
