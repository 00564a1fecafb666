"""Runs units of work as Ray tasks, with retries and cancellation."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from ..progress import ProgressBar
from ..errors import CommandKilled, IplwError
from .connect import connect
from .machine import Ran, this_machine
from .results import Results

I = TypeVar("I")
T = TypeVar("T")
#: Interval between updates of the progress bar, s.
_REDRAW_INTERVAL_S = 0.5


class UnitFailed(IplwError):
    """A unit failed, or was killed in each of its attempts. `index` is its number, `__cause__` the reason."""

    def __init__(self, index: int, item: str, why: str) -> None:
        super().__init__(index, item, why)
        self.index = index
        self.item = item
        self.why = why

    def __str__(self) -> str:
        return f"unit {self.index} ({self.item}) failed: {self.why}"


class MixedVersions(IplwError):
    """A node has another version of iplw than this process; their results must not be mixed."""

    def __init__(self, host: str, node_version: str, own_version: str) -> None:
        super().__init__(host, node_version, own_version)

    def __str__(self) -> str:
        host, node_version, own_version = self.args
        return f"node {host} has iplw {node_version} and this is iplw {own_version}; install iplw=={own_version} on every node"


def map(
    function: Callable[[I], T],
    items: Iterable[I],
    *,
    num_cpus: int = 1,
    tries: int = 3,
    errors: Literal["raise", "return"] = "raise",
    progress: bool = True,
    address: str | None = None,
    label: str = "units",
) -> Results[T]:
    """`[function(item) for item in items]`, each on a node of the cluster as soon as `num_cpus` cores are free.

    `num_cpus`: cores, and threads, of each unit. A unit whose process or node is killed is restarted, up to `tries` attempts
    in all; one that raises is not. With `errors="raise"` the first failure cancels the others and is raised; with "return"
    the `UnitFailed` is returned in its place. `label` names the progress bar.
    """
    _check_positive_int("num_cpus", num_cpus)
    _check_positive_int("tries", tries)
    if errors not in ("raise", "return"):
        raise ValueError(f"errors is {errors!r}; allowed: 'raise' or 'return'")
    inputs = list(items)
    ray = connect(address)
    task = ray.remote(_run_unit).options(
        num_cpus=num_cpus, max_retries=tries - 1, retry_exceptions=[CommandKilled], name=label
    )
    # Stored once for all units; it may be large.
    shared = ray.put(_SharedInput(function, _version(), num_cpus))
    running = {task.remote(shared, item): index for index, item in enumerate(inputs)}
    values: list[Any] = [None] * len(inputs)
    ran: list[Ran | None] = [None] * len(inputs)
    try:
        for ref in _as_completed(ray, list(running), label if progress else None):
            index = running.pop(ref)
            try:
                values[index], ran[index] = ray.get(ref)
            except ray.exceptions.RayError as error:
                values[index] = _failure(index, inputs[index], error)
                if errors == "raise" or isinstance(values[index], MixedVersions):
                    raise values[index] from values[index].__cause__
    finally:
        for ref in running:
            ray.cancel(ref)
    results = Results(values, inputs, ran)
    if not results.alike:
        warnings.warn(_mixed_machines_warning(results), stacklevel=2)
    return results


@dataclass(frozen=True)
class _SharedInput(Generic[I, T]):
    """Input of all units."""

    function: Callable[[I], T]
    #: Version of iplw of the calling process.
    version: str
    threads: int


def _run_unit(shared: _SharedInput[I, T], item: I) -> tuple[T, Ran]:
    """Executes one unit on a node."""
    ray = connect()
    machine = this_machine()
    for version in (_version(), machine.version):
        if version != shared.version:
            raise MixedVersions(machine.host, version, shared.version)
    started = time.perf_counter()
    with _thread_limit(shared.threads):
        value = shared.function(item)
    seconds = time.perf_counter() - started
    return value, Ran(machine, ray.get_runtime_context().get_node_id(), shared.threads, seconds)


@contextmanager
def _thread_limit(threads: int) -> Iterator[None]:
    """Limits the threads of iplw processes that the function starts, such as a private server."""
    name = "RAYON_NUM_THREADS"
    before = os.environ.get(name)
    os.environ[name] = str(threads)
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def _as_completed(ray: Any, pending: list[Any], label: str | None) -> Iterator[Any]:
    """Yields references as their units end, and updates the progress bar."""
    bar, started, total = ProgressBar(), time.monotonic(), len(pending)
    while pending:
        if label is not None:
            _draw_progress(bar, label, total - len(pending), total, time.monotonic() - started)
        ended, pending = ray.wait(pending, timeout=_REDRAW_INTERVAL_S)
        yield from ended
    if label is not None:
        _draw_progress(bar, label, total, total, time.monotonic() - started)
        bar.finish()


def _draw_progress(bar: ProgressBar, label: str, done: int, total: int, elapsed: float) -> None:
    left = elapsed / done * (total - done) if done else None
    # Not a terminal: one line for each tenth.
    tenths = "" if sys.stderr.isatty() or not total else f", {10 * (10 * done // total)} %"
    stage = {"stage": f"{label}{tenths}", "done": done, "total": total, "eta_s": left}
    bar.draw({"kind": "cluster", "progress": stage})


def _failure(index: int, item: object, error: Exception) -> IplwError:
    """Converts an error of Ray: the unit's own exception, if it raised one, else the reason that Ray gives."""
    cause = getattr(error, "cause", None)
    if isinstance(cause, MixedVersions):
        return cause
    cause = cause if isinstance(cause, BaseException) else error
    text = repr(item)
    why = str(cause) if isinstance(cause, IplwError) else f"{type(cause).__name__}: {cause}"
    if "No module named 'iplw'" in why:
        why = f"a node has no iplw; pip install 'iplw[ray]=={_version()}' on every node"
    failed = UnitFailed(index, text if len(text) <= 80 else text[:77] + "...", why)
    failed.__cause__ = cause
    return failed


def _mixed_machines_warning(results: Results[Any]) -> str:
    kinds = "; ".join(", ".join(kind) for kind in results.kinds)
    return f"units were computed on machines of {len(results.kinds)} kinds ({kinds}): the last bits may differ between them"


def _check_positive_int(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError(f"{name} is {value!r}; allowed: an integer from 1")


def _version() -> str:
    from .. import __version__  # Imported here: the package may still be importing this module.

    return __version__
