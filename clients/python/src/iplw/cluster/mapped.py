"""Units of work as Ray tasks: handed out, waited for, tried again, and taken back when one cannot be."""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from ..bar import Bar
from ..errors import CommandKilled, IplwError
from .connect import connect
from .place import Ran, here
from .results import Results

I = TypeVar("I")
T = TypeVar("T")
#: How often the bar is drawn while nothing ends, s.
_DRAW = 0.5


class UnitFailed(IplwError):
    """A unit failed, or was killed as often as it was tried. `index` says which; `__cause__` why."""

    def __init__(self, index: int, item: str, why: str) -> None:
        super().__init__(index, item, why)
        self.index = index
        self.item = item
        self.why = why

    def __str__(self) -> str:
        return f"unit {self.index} ({self.item}) failed: {self.why}"


class MixedVersions(IplwError):
    """A node has another version of iplw than the program that asks: results of two are not to be mixed."""

    def __init__(self, host: str, theirs: str, ours: str) -> None:
        super().__init__(host, theirs, ours)

    def __str__(self) -> str:
        host, theirs, ours = self.args
        return f"node {host} has iplw {theirs} and this is iplw {ours}; install iplw=={ours} on every node"


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
    """`[function(item) for item in items]`, each on some node of the cluster as soon as `num_cpus` cores are free.

    `num_cpus` whole cores are a unit's, and as many threads it computes with. A unit whose process or node is killed
    is begun anew, up to `tries` times in all; one that raises is not. With `errors="raise"` the first failure ends the
    others and is raised; with "return" the `UnitFailed` stands in its place. `label` names the progress bar.
    """
    _whole("num_cpus", num_cpus)
    _whole("tries", tries)
    if errors not in ("raise", "return"):
        raise ValueError(f"errors is {errors!r}; allowed: 'raise' or 'return'")
    asked = list(items)
    ray = connect(address)
    task = ray.remote(_carry_out).options(
        num_cpus=num_cpus, max_retries=tries - 1, retry_exceptions=[CommandKilled], name=label
    )
    # Once for all units, however large it is.
    work = ray.put(_Work(function, _version(), num_cpus))
    running = {task.remote(work, item): index for index, item in enumerate(asked)}
    values: list[Any] = [None] * len(asked)
    ran: list[Ran | None] = [None] * len(asked)
    try:
        for ref in _ending(ray, list(running), label if progress else None):
            index = running.pop(ref)
            try:
                values[index], ran[index] = ray.get(ref)
            except ray.exceptions.RayError as error:
                values[index] = _failure(index, asked[index], error)
                if errors == "raise" or isinstance(values[index], MixedVersions):
                    raise values[index] from values[index].__cause__
    finally:
        for ref in running:
            ray.cancel(ref)
    found = Results(values, asked, ran)
    if not found.alike:
        warnings.warn(_unlike(found), stacklevel=2)
    return found


@dataclass(frozen=True)
class _Work(Generic[I, T]):
    """What every unit is given."""

    function: Callable[[I], T]
    #: The version of iplw that asks.
    version: str
    threads: int


def _carry_out(work: _Work[I, T], item: I) -> tuple[T, Ran]:
    """One unit, on a node."""
    ray = connect()
    machine = here()
    for version in (_version(), machine.version):
        if version != work.version:
            raise MixedVersions(machine.host, version, work.version)
    started = time.perf_counter()
    with _threads(work.threads):
        value = work.function(item)
    seconds = time.perf_counter() - started
    return value, Ran(machine, ray.get_runtime_context().get_node_id(), work.threads, seconds)


@contextmanager
def _threads(threads: int) -> Iterator[None]:
    """What the function starts of iplw, a private server say, computes with so many."""
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


def _ending(ray: Any, pending: list[Any], label: str | None) -> Iterator[Any]:
    """Units as they end; a bar over all of them."""
    bar, started, total = Bar(), time.monotonic(), len(pending)
    while pending:
        if label is not None:
            _draw(bar, label, total - len(pending), total, time.monotonic() - started)
        ended, pending = ray.wait(pending, timeout=_DRAW)
        yield from ended
    if label is not None:
        _draw(bar, label, total, total, time.monotonic() - started)
        bar.finish()


def _draw(bar: Bar, label: str, done: int, total: int, elapsed: float) -> None:
    left = elapsed / done * (total - done) if done else None
    # Where it is not drawn in place, a line for each tenth.
    tenths = "" if sys.stderr.isatty() or not total else f", {10 * (10 * done // total)} %"
    stage = {"stage": f"{label}{tenths}", "done": done, "total": total, "eta_s": left}
    bar.draw({"kind": "cluster", "progress": stage})


def _failure(index: int, item: object, error: Exception) -> IplwError:
    """What a unit's error means: its own exception where it raised one, else what Ray says of its end."""
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


def _unlike(found: Results[Any]) -> str:
    kinds = "; ".join(", ".join(kind) for kind in found.kinds)
    return f"units were computed on machines of {len(found.kinds)} kinds ({kinds}): last bits may differ between them"


def _whole(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise ValueError(f"{name} is {value!r}; allowed: a whole number from 1")


def _version() -> str:
    from .. import __version__  # Later than at import: the package may be importing us.

    return __version__
