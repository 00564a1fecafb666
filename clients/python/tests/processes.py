"""Processes as Linux tells them, for tests of what becomes of those that we start."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def until(condition: Callable[[], T], seconds: float = 60.0) -> T:
    """Waits for something that others bring about, and gives what it was."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.02)
    return found


def children(pid: int) -> list[int]:
    """Processes that this one started."""
    try:
        told = Path(f"/proc/{pid}/task").glob("*/children")
        return [int(word) for path in told for word in path.read_text().split()]
    except OSError:
        return []


def programs(pid: int) -> list[int]:
    """Those of them that compute a unit."""
    return [child for child in children(pid) if "--exit-with-stdin" in words(child) and "serve" not in words(child)]


def words(pid: int) -> list[str]:
    """A process's command line; none once it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    except OSError:
        return []
