"""Connects to Ray, if it is installed."""

from __future__ import annotations

import importlib
import os
from typing import Any

from ..errors import IplwError

#: Address of the current connection.
_address: str | None = None


def connect(address: str | None = None) -> Any:
    """The module `ray`, connected to `address`, else RAY_ADDRESS, else a local cluster that ends with this process. An
    existing connection is reused."""
    global _address
    ray = _module()
    if ray.is_initialized():
        if address not in (None, _address):
            raise ValueError(
                f"address is {address!r}; Ray is already connected; leave it out, or call ray.shutdown() first"
            )
        return ray
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "warning"}
    if address is None and not os.environ.get("RAY_ADDRESS"):
        # Disable usage reports of a cluster that is started here.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        options |= {"include_dashboard": False}
    ray.init(address=address, **options)
    _address = address
    return ray


def _module() -> Any:
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise IplwError(f"iplw.cluster requires Ray: pip install 'iplw[ray]' ({error})") from error
