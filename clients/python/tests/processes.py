"""Reads /proc, for tests of subprocesses."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def until(condition: Callable[[], T], seconds: float = 60.0) -> T:
    """Waits until the condition is true and returns its value."""
    end = time.monotonic() + seconds
    while not (result := condition()):
        assert time.monotonic() < end, "condition not met in time"
        time.sleep(0.02)
    return result


def children(pid: int) -> list[int]:
    """Child processes."""
    try:
        response = Path(f"/proc/{pid}/task").glob("*/children")
        return [int(word) for path in response for word in path.read_text().split()]
    except OSError:
        return []


def programs(pid: int) -> list[int]:
    """Descendants that run a command of iplw."""
    return [child for child in children(pid) if "--exit-with-stdin" in words(child) and "serve" not in words(child)]


def words(pid: int) -> list[str]:
    """Command line of a process; empty once it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    except OSError:
        return []
