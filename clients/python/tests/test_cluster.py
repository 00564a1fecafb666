"""Units of work on a cluster of two nodes with one core each, and what may happen to them meanwhile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from processes import programs, until, words

import iplw
from iplw import cluster
from iplw.cluster import Ran, Results, sweeps
from iplw.cluster.place import here
from iplw.unit import Output, command, compute

SMALL = {"rounds": 1, "actions": 4, "samples": 24}
#: A unit of some seconds: long enough to be interrupted.
LONG = command("estimate", task="bowling", rounds=1, actions=6, json=True)


@pytest.fixture(scope="module", name="nodes")
def two_nodes() -> Iterator[Any]:
    """Ray's own cluster for tests; this process is connected to its head."""
    patch = pytest.MonkeyPatch()
    patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    # Ray's processes are otherwise the last to get what the machine has left.
    patch.setenv("RAY_worker_niceness", "0")
    import ray
    from ray.cluster_utils import Cluster

    # Functions go by their names: nodes have these modules as well.
    here = Path(__file__).resolve().parent
    patch.setenv("PYTHONPATH", f"{here.parent / 'src'}:{here}")
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        nodes.add_node(num_cpus=1)
        ray.init(address=nodes.address, log_to_driver=False, logging_level="error")
        yield nodes
    finally:
        ray.shutdown()
        nodes.shutdown()
        patch.undo()


@pytest.fixture(name="background")
def in_background() -> Iterator[Callable[..., Future[Any]]]:
    """Runs a function beside the test."""
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit


class Told:
    """A function for `cluster.map` that tells where it runs, by a file each try: the worker's process and node."""

    def __init__(self, directory: Path, work: Callable[[Any], Any]) -> None:
        self.directory = directory
        self.work = work

    def __call__(self, item: Any) -> Any:
        import ray

        node = ray.get_runtime_context().get_node_id()
        (self.directory / f"{item}.{os.getpid()}.{node}.{time.time_ns()}").touch()
        return self.work(item)

    def tries(self) -> list[tuple[str, int, str]]:
        """(item, process, node) of every try, the first first."""
        rows = [path.name.split(".") for path in self.directory.iterdir()]
        return [(item, int(pid), node) for item, pid, node, _ in sorted(rows, key=lambda row: int(row[3]))]


def threads(_item: object) -> str:
    """What programs that a unit starts compute with, if they are not told otherwise."""
    return os.environ["RAYON_NUM_THREADS"]


def estimated(seed: int) -> dict[str, Any]:
    """A unit that takes some seconds."""
    report: dict[str, Any] = compute([[*LONG, f"--seed={seed}"]], threads=1).json()
    del report["seconds"]
    return report


def test_results_are_those_of_one_process_in_the_order_of_the_seeds(nodes: Any, capsys: Any) -> None:
    found = cluster.estimate("basketball", seeds=range(6), settings=SMALL)
    alone = [
        compute([command("estimate", task="basketball", **SMALL, seed=seed, json=True)], threads=2).json()
        for seed in range(6)
    ]
    assert [report.pop("seconds") > 0 for report in alone] == [True] * 6
    assert found == alone
    assert found.items == [{"seed": seed} for seed in range(6)]
    assert [report["seed"] for report in found] == list(range(6))
    assert len({ran.node for ran in found.ran if ran}) == 2, "both nodes had something to do"
    assert found.alike
    first = found.ran[0]
    assert first is not None and first.machine.version == iplw.__version__ and first.threads == 1
    told = capsys.readouterr().err
    assert "cluster: estimate, 0 %" in told and "cluster: estimate, 100 %" in told


def test_a_node_that_is_taken_away_changes_no_bit(nodes: Any, background: Any, tmp_path: Path) -> None:
    doomed = nodes.add_node(num_cpus=2)
    # Only there are two cores; a unit computes with as many threads.
    found = cluster.map(threads, [0], num_cpus=2, progress=False)
    assert found == ["2"]
    assert [(ran.node, ran.threads) for ran in found.ran if ran] == [(doomed.node_id, 2)]

    def begun_on_every_core(seed: int) -> dict[str, Any]:
        until(lambda: len(list(tmp_path.iterdir())) >= 4)
        return estimated(seed)

    told = Told(tmp_path, begun_on_every_core)
    running = background(cluster.map, told, range(4), progress=False)
    workers = until(lambda: [pid for _, pid, node in told.tries() if node == doomed.node_id])
    started = until(lambda: [program for worker in workers for program in programs(worker)])
    nodes.remove_node(doomed, allow_graceful=False)
    until(lambda: not any(words(program) for program in started))
    found = running.result(timeout=120)
    assert len(told.tries()) > 4, "its units were begun anew"
    assert found == [estimated(seed) for seed in range(4)]


def test_what_a_killed_worker_started_ends_with_it_and_its_unit_is_tried_again(
    nodes: Any, background: Any, tmp_path: Path
) -> None:
    told = Told(tmp_path, estimated)
    running = background(cluster.map, told, [7], progress=False)
    _, worker, _ = until(told.tries)[0]
    program = until(lambda: programs(worker))[0]
    os.kill(worker, signal.SIGKILL)
    until(lambda: not words(program), seconds=15)
    # Then its program alone: the worker stays, and the unit is tried again as well.
    _, worker, _ = until(lambda: told.tries()[1:])[0]
    os.kill(until(lambda: programs(worker))[0], signal.SIGKILL)
    assert running.result(timeout=60) == [estimated(7)]
    assert len(told.tries()) == 3


def dies(_item: object) -> None:
    """Takes its process along."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_unit_that_kills_its_process_is_tried_no_more_than_it_may(nodes: Any, tmp_path: Path) -> None:
    told = Told(tmp_path, dies)
    with pytest.raises(cluster.UnitFailed, match="unit 0 .*died"):
        cluster.map(told, [0], tries=2, progress=False)
    assert len(told.tries()) == 2


def halves(item: int) -> int:
    """Of even numbers only."""
    if item % 2:
        raise ValueError(f"{item} is odd")
    return item // 2


def test_failures_are_raised_or_returned_and_not_tried_again(nodes: Any) -> None:
    with pytest.raises(cluster.UnitFailed, match=r"unit 1 \(3\) failed: ValueError: 3 is odd") as failed:
        cluster.map(halves, [4, 3], progress=False)
    assert isinstance(failed.value.__cause__, ValueError)
    found = cluster.map(halves, [4, 3, 2], errors="return", progress=False)
    failure: object = found[1]
    assert isinstance(failure, cluster.UnitFailed) and failure.why == "ValueError: 3 is odd"
    assert (found[0], found[2]) == (2, 1)
    assert found.ran[1] is None
    with pytest.raises(cluster.UnitFailed, match="`iplw estimate .* ended with code 2: .*rounds"):
        cluster.run([["estimate", "--rounds", "0"]], progress=False)


def test_the_first_failure_ends_what_still_runs(nodes: Any, tmp_path: Path) -> None:
    def either(item: int) -> None:
        if item == 0:
            until(lambda: list(tmp_path.glob("1.*")))
            raise ValueError("enough")
        compute([[*LONG, "--preset=paper"]])

    told = Told(tmp_path, either)
    with pytest.raises(cluster.UnitFailed, match="enough"):
        cluster.map(told, [1, 0], progress=False)
    worker = next(pid for item, pid, _ in told.tries() if item == "1")
    until(lambda: not programs(worker), seconds=15)


def test_a_policy_goes_to_the_nodes_as_a_file(nodes: Any) -> None:
    train = command("train", task="basketball", per_task=40, batches=20, out="made/policy")
    weights = cluster.run([train, [train]], progress=False)
    assert weights[0].files == weights[1].files, "trained twice, on two nodes: the same weights"
    assert list(weights[0].files) == ["made/policy"]
    policy = weights[0].files["made/policy"]
    found = cluster.evaluate(
        policy, "basketball", seeds=[1, 2], settings={"candidates": 200, "split": "validation"}, progress=False
    )
    assert [0.0 <= score["auccess"] <= 1.0 for score in found] == [True, True]
    evaluate = command("evaluate", task="basketball", policy="p", candidates=200, split="validation", seed=2, json=True)
    assert compute([evaluate], files={"p": policy}).json() == found[1]


def test_a_program_finds_the_cluster_by_its_address(nodes: Any, tmp_path: Path) -> None:
    sweep = Path(__file__).resolve().parents[3] / "examples" / "cluster" / "sweep.py"
    small = ["--task", "basketball", "--seeds", "2", "--rounds", "1", "--out", str(tmp_path / "sweep.csv")]
    there = {**os.environ, "RAY_ADDRESS": nodes.address}
    run = subprocess.run([sys.executable, sweep, *small], env=there, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "4 estimations" in run.stderr
    rows = [line.split(",") for line in (tmp_path / "sweep.csv").read_text().splitlines()[1:]]
    cells = [(damping, seed) for damping in ("0.8", "0.9") for seed in ("0", "1")]
    assert [(row[0], row[1]) for row in rows[::3]] == cells, "three latents each"


def test_hidden_worlds_by_seeds_make_a_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def noted(commands: Any, *, threads: int) -> Output:
        asked.append((commands, threads))
        return Output("", {"found/report.json": b'{"verdict": "explained"}'})

    monkeypatch.setattr(sweeps, "compute", noted)
    monkeypatch.setattr(sweeps, "map", lambda work, items, **_: Results([work(i) for i in items], items, []))
    worlds = ["linear_drag:c=0.4", ["quadratic_drag:k=0.05", "linear_drag:c=0.2"]]
    found = cluster.diagnose("tossing", over={"effect": worlds}, seeds=[1, 2], settings={"trials": 4}, num_cpus=2)
    assert found.items == [{"effect": world, "seed": seed} for world in worlds for seed in (1, 2)]
    assert [report["verdict"] for report in found] == ["explained"] * 4
    (measure, diagnose), threads = asked[3]
    assert threads == 2
    effects = ["--effect=quadratic_drag:k=0.05", "--effect=linear_drag:c=0.2"]
    assert measure == ["measure", "--task=tossing", "--trials=4", *effects, "--seed=2", "--out=measured"]
    trials = ["--scene=measured/scene.json", "--trials=measured/trials.csv"]
    assert diagnose == ["diagnose", *trials, "--seed=2", "--out=found"]
    with pytest.raises(ValueError, match="allowed: seeds="):
        cluster.diagnose("tossing", over={"seed": [1]})


def test_versions_are_not_mixed(nodes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = iplw.__version__
    monkeypatch.setattr(iplw, "__version__", "99.1.0")
    with pytest.raises(cluster.MixedVersions, match=f"has iplw {theirs} and this is iplw 99.1.0; install iplw==99.1.0"):
        cluster.map(halves, [4], errors="return", progress=False)


def test_machines_of_two_kinds_are_told() -> None:
    machine = here()
    wide = replace(machine, instructions="x86_64 avx512f fma avx2")

    def alike(**other: str) -> bool:
        machines = (wide, replace(wide, **other))
        return Results([1, 2], [1, 2], [Ran(one, "node", 1, 0.1) for one in machines]).alike

    assert alike(host="other", cpu="other") and alike(instructions="x86_64 fma avx2")
    # Weights of policies were seen to differ without fused operations.
    assert not alike(instructions="x86_64 avx2")
    assert not alike(libc="glibc 2.28") and not alike(build="0123456789ab")


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({"num_cpus": 0.5}, "num_cpus is 0.5; allowed: a whole number from 1"),
        ({"tries": 0}, "tries is 0; allowed: a whole number from 1"),
        ({"errors": "ignore"}, "errors is 'ignore'; allowed: 'raise' or 'return'"),
    ],
)
def test_options_that_cannot_be_are_named(options: dict[str, Any], wanted: str) -> None:
    with pytest.raises(ValueError, match=wanted):
        cluster.map(halves, [2], **options)


def test_without_ray_there_is_a_clear_error_and_only_when_it_is_needed() -> None:
    asks = (
        "import sys; sys.modules['ray'] = None\n"
        "from iplw import cluster\n"
        "try: cluster.map(len, [''])\n"
        "except Exception as e: print(type(e).__name__, e)\n"
    )
    run = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True)
    assert run.stdout.startswith("IplwError iplw.cluster needs Ray, which is not here: pip install 'iplw[ray]'")
