"""Commands of the program on a cluster: estimations, evaluations, diagnoses, and any other."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypedDict

from typing_extensions import Unpack

from ..cli import Output, check, command, compute
from .parallel import map
from .results import Results

#: A command, or several that run argv after the other in argv directory.
Unit = Sequence[str] | Sequence[Sequence[str]]


class Options(TypedDict, total=False):
    """Execution options; see `iplw.cluster.map`."""

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

    A unit is a command or a list of commands, in a separate directory with `files` in it (relative path -> content,
    or a local path to read). Paths in options are relative to that directory; files that commands write there are returned
    as `Output.files`. `--threads` is set to `num_cpus`.
    """
    commands_by_unit = [_commands(unit) for unit in units]
    shared = {name: _content(content) for name, content in (files or {}).items()}
    return map(partial(_output, shared, _threads(options)), commands_by_unit, **_with_label(options, "commands"))


def estimate(
    task: str = "bowling",
    *,
    seeds: Iterable[int] = (0,),
    over: Mapping[str, Iterable[object]] | None = None,
    surface: str | Path | None = None,
    settings: Mapping[str, object] | None = None,
    **options: Unpack[Options],
) -> Results[dict[str, Any]]:
    """Estimates latents of hidden worlds: `iplw estimate` for each seed and each combination of `over`.

    `settings`: options of the command (`{"preset": "paper", "rounds": 3, "real": {"damping": 0.8}}`); `over`: options with
    several values: `{"real": [{"damping": 0.8}, {"damping": 0.9}]}`. Results are the command's reports, without `seconds`
    (see `ran`); `items` are the combinations, with the seed varying fastest.
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
    """Evaluates a policy (weights, or their file) in hidden worlds: `iplw evaluate`, varied as in `estimate`."""
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
    """Measures and diagnoses a grid of hidden worlds: `iplw measure`, then `iplw diagnose` on its trials.

    `settings` and `over` are options of `iplw measure`: `over={"effect": ["wind:...", ["quadratic_drag:k=0.05",
    "linear_drag:c=0.2"]]}` (a list gives several effects together), `settings={"trials": 20, "noise": 0.002}`. Both commands
    use the seed. Results are the reports (`iplw.diagnosis`).
    """
    fixed = {"task": task, **(settings or {})}
    work = partial(_diagnosis, fixed, _threads(options))
    return map(work, _combinations(over, seeds), **_with_label(options, "diagnose"))


def _combinations(over: Mapping[str, Iterable[object]] | None, seeds: Iterable[int]) -> list[dict[str, Any]]:
    grid: dict[str, list[object]] = {name: list(values) for name, values in (over or {}).items()}
    if "seed" in grid:
        raise ValueError("over has 'seed'; allowed: seeds=...")
    grid["seed"] = list(seeds)
    return [dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values())]


def _report(
    name: str, fixed: dict[str, Any], files: dict[str, bytes], threads: int, item: dict[str, Any]
) -> dict[str, Any]:
    report = compute([command(name, **fixed, **item)], files=files, threads=threads).json()
    # The only field that is not reproducible.
    report.pop("seconds", None)
    return dict(report)


def _diagnosis(fixed: dict[str, Any], threads: int, item: dict[str, Any]) -> dict[str, Any]:
    measure = command("measure", **fixed, **item, out="measured")
    files = {"scene": "measured/scene.json", "trials": "measured/trials.csv"}
    diagnose = command("diagnose", **files, seed=item["seed"], out="diagnosis")
    return dict(compute([measure, diagnose], threads=threads).json("diagnosis/report.json"))


def _output(files: dict[str, bytes], threads: int, commands: list[list[str]]) -> Output:
    return compute(commands, files=files, threads=threads)


def _commands(unit: Unit) -> list[list[str]]:
    """A unit as a list of validated commands."""
    if isinstance(unit, str) or not unit:
        raise ValueError(f'a unit is {unit!r}; allowed: a command such as ["estimate", "--seed", "1"], or several')
    first = unit[0]
    return [check(argv) for argv in ([unit] if isinstance(first, str) else unit)]  # type: ignore[arg-type]


def _content(content: bytes | str | Path) -> bytes:
    return content if isinstance(content, bytes) else Path(content).read_bytes()


def _threads(options: Options) -> int:
    return options.get("num_cpus", 1)


def _with_label(options: Options, label: str) -> Options:
    return {"label": label, **options}
