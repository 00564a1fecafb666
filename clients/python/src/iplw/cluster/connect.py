"""Ray, if it is installed, and connected."""

from __future__ import annotations

import importlib
import os
from typing import Any

from ..errors import IplwError

#: The address that we connected to last.
_address: str | None = None


def connect(address: str | None = None) -> Any:
    """The module `ray`, connected: to what it is connected to already, else `address`, else RAY_ADDRESS, else a cluster
    on this machine that is started and stays until this process ends."""
    global _address
    ray = _module()
    if ray.is_initialized():
        if address not in (None, _address):
            raise ValueError(
                f"address is {address!r}; allowed: None, as Ray is connected already, or call ray.shutdown() first"
            )
        return ray
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "warning"}
    if address is None and not os.environ.get("RAY_ADDRESS"):
        # Nothing that is started here tells others of it.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        options |= {"include_dashboard": False}
    ray.init(address=address, **options)
    _address = address
    return ray


def _module() -> Any:
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise IplwError(f"iplw.cluster needs Ray, which is not here: pip install 'iplw[ray]' ({error})") from error
