"""The program's commands on many machines: estimations, evaluations, diagnoses, and any other."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypedDict

from typing_extensions import Unpack

from ..unit import Output, check, command, compute
from .mapped import map
from .results import Results

#: A command, or several that run one after the other in one directory.
Unit = Sequence[str] | Sequence[Sequence[str]]


class Options(TypedDict, total=False):
    """How units are carried out; see `iplw.cluster.map`."""

    num_cpus: int
    tries: int
    errors: Literal["raise", "return"]
    progress: bool
    address: str | None
    label: str


def run(
    units: Iterable[Unit], *, files: Mapping[str, bytes | Path] | None = None, **options: Unpack[Options]
) -> Results[Output]:
    """Runs commands of the program on the cluster, `[["estimate", "--seed", "1"], ["estimate", "--seed", "2"]]`.

    A unit is a command or a list of commands, in a directory of its own with `files` in it (path below it -> contents,
    or a path here to read). Options that name files or directories name them below that directory; whatever commands
    write there comes back as `Output.files`. `--threads` is added and follows `num_cpus`.
    """
    wanted = [_commands(unit) for unit in units]
    shared = {name: _content(given) for name, given in (files or {}).items()}
    return map(partial(_output, shared, _threads(options)), wanted, **_with_label(options, "commands"))


def estimate(
    task: str = "bowling",
    *,
    seeds: Iterable[int] = (0,),
    over: Mapping[str, Iterable[object]] | None = None,
    surface: str | Path | None = None,
    settings: Mapping[str, object] | None = None,
    **options: Unpack[Options],
) -> Results[dict[str, Any]]:
    """Estimates latents of hidden worlds: `iplw estimate` for each seed and each combination of what `over` varies.

    `settings` are the command's options (`{"preset": "paper", "rounds": 3, "real": {"damping": 0.8}}`); `over` gives
    several values to some: `{"real": [{"damping": 0.8}, {"damping": 0.9}]}`. Results are the command's reports, without
    the seconds it took (`ran` has those); `items` are the combinations, the seed varying fastest.
    """
    fixed = {"task": task, **(settings or {}), **({"surface": "surface.json"} if surface else {}), "json": True}
    files = {"surface.json": Path(surface).read_bytes()} if surface else {}
    combinations = _combinations(over, seeds)
    work = partial(_report, "estimate", fixed, files, _threads(options))
    return map(work, combinations, **_with_label(options, "estimate"))


def evaluate(
    policy: str | Path | bytes,
    task: str,
    *,
    seeds: Iterable[int] = (0,),
    over: Mapping[str, Iterable[object]] | None = None,
    settings: Mapping[str, object] | None = None,
    **options: Unpack[Options],
) -> Results[dict[str, Any]]:
    """Tries a policy (weights, or their file) in hidden worlds: `iplw evaluate`, varied as `estimate` is."""
    weights = policy if isinstance(policy, bytes) else Path(policy).read_bytes()
    fixed = {"task": task, **(settings or {}), "policy": "policy.safetensors", "json": True}
    work = partial(_report, "evaluate", fixed, {"policy.safetensors": weights}, _threads(options))
    return map(work, _combinations(over, seeds), **_with_label(options, "evaluate"))


def diagnose(
    task: str,
    *,
    seeds: Iterable[int] = (0,),
    over: Mapping[str, Iterable[object]] | None = None,
    settings: Mapping[str, object] | None = None,
    **options: Unpack[Options],
) -> Results[dict[str, Any]]:
    """A matrix of hidden worlds, each measured and diagnosed: `iplw measure`, then `iplw diagnose` on its trials.

    `settings` and `over` are options of `iplw measure`: `over={"effect": ["wind:...", ["quadratic_drag:k=0.05",
    "linear_drag:c=0.2"]]}` (a list is several effects at once), `settings={"trials": 20, "noise": 0.002}`. The seed is
    both commands'. Results are the reports (`iplw.diagnosis`).
    """
    fixed = {"task": task, **(settings or {})}
    work = partial(_diagnosis, fixed, _threads(options))
    return map(work, _combinations(over, seeds), **_with_label(options, "diagnose"))


def _combinations(over: Mapping[str, Iterable[object]] | None, seeds: Iterable[int]) -> list[dict[str, Any]]:
    varied: dict[str, list[object]] = {name: list(values) for name, values in (over or {}).items()}
    if "seed" in varied:
        raise ValueError("over has 'seed'; allowed: seeds=...")
    varied["seed"] = list(seeds)
    return [dict(zip(varied, chosen, strict=True)) for chosen in itertools.product(*varied.values())]


def _report(
    name: str, fixed: dict[str, Any], files: dict[str, bytes], threads: int, item: dict[str, Any]
) -> dict[str, Any]:
    found = compute([command(name, **fixed, **item)], files=files, threads=threads).json()
    # A clock's: all else is the same whenever and wherever it is computed.
    found.pop("seconds", None)
    return dict(found)


def _diagnosis(fixed: dict[str, Any], threads: int, item: dict[str, Any]) -> dict[str, Any]:
    measure = command("measure", **fixed, **item, out="measured")
    files = {"scene": "measured/scene.json", "trials": "measured/trials.csv"}
    diagnose = command("diagnose", **files, seed=item["seed"], out="found")
    return dict(compute([measure, diagnose], threads=threads).json("found/report.json"))


def _output(files: dict[str, bytes], threads: int, commands: list[list[str]]) -> Output:
    return compute(commands, files=files, threads=threads)


def _commands(unit: Unit) -> list[list[str]]:
    """A unit as a list of commands, each of those that compute."""
    if isinstance(unit, str) or not unit:
        raise ValueError(f'a unit is {unit!r}; allowed: a command such as ["estimate", "--seed", "1"], or several')
    first = unit[0]
    return [check(one) for one in ([unit] if isinstance(first, str) else unit)]  # type: ignore[arg-type]


def _content(given: bytes | str | Path) -> bytes:
    return given if isinstance(given, bytes) else Path(given).read_bytes()


def _threads(options: Options) -> int:
    return options.get("num_cpus", 1)


def _with_label(options: Options, label: str) -> Options:
    return {"label": label, **options}
