"""Units of work on a cluster of two nodes with one core each, with failures."""

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
from iplw.cluster.machine import this_machine
from iplw.cli import Output, command, compute

SMALL = {"rounds": 1, "actions": 4, "samples": 24}
#: A unit that takes some seconds, so that it can be interrupted.
LONG = command("estimate", task="bowling", rounds=1, actions=6, json=True)


@pytest.fixture(scope="module", name="nodes")
def two_nodes() -> Iterator[Any]:
    """Ray's test cluster; this process is connected to its head."""
    patch = pytest.MonkeyPatch()
    patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    # Without this, Ray lowers the priority of its workers.
    patch.setenv("RAY_worker_niceness", "0")
    import ray
    from ray.cluster_utils import Cluster

    # Functions are pickled by name: nodes must find these modules.
    local = Path(__file__).resolve().parent
    patch.setenv("PYTHONPATH", f"{local.parent / 'src'}:{local}")
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
    """Runs a function in another thread."""
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit


class RecordingFunction:
    """A function for `cluster.map` that records process and node of each attempt in a file."""

    def __init__(self, directory: Path, work: Callable[[Any], Any]) -> None:
        self.directory = directory
        self.work = work

    def __call__(self, item: Any) -> Any:
        import ray

        node = ray.get_runtime_context().get_node_id()
        (self.directory / f"{item}.{os.getpid()}.{node}.{time.time_ns()}").touch()
        return self.work(item)

    def tries(self) -> list[tuple[str, int, str]]:
        """(item, process, node) of each attempt, in order."""
        rows = [path.name.split(".") for path in self.directory.iterdir()]
        return [(item, int(pid), node) for item, pid, node, _ in sorted(rows, key=lambda row: int(row[3]))]


def threads(_item: object) -> str:
    """Default thread count of programs that a unit starts."""
    return os.environ["RAYON_NUM_THREADS"]


def estimate_unit(seed: int) -> dict[str, Any]:
    """A unit that takes some seconds."""
    report: dict[str, Any] = compute([[*LONG, f"--seed={seed}"]], threads=1).json()
    del report["seconds"]
    return report


def test_results_match_local_run_in_seed_order(nodes: Any, capsys: Any) -> None:
    results = cluster.estimate("basketball", seeds=range(6), settings=SMALL)
    alone = [
        compute([command("estimate", task="basketball", **SMALL, seed=seed, json=True)], threads=2).json()
        for seed in range(6)
    ]
    assert [report.pop("seconds") > 0 for report in alone] == [True] * 6
    assert results == alone
    assert results.items == [{"seed": seed} for seed in range(6)]
    assert [report["seed"] for report in results] == list(range(6))
    assert len({ran.node for ran in results.ran if ran}) == 2, "both nodes were used"
    assert results.alike
    first = results.ran[0]
    assert first is not None and first.machine.version == iplw.__version__ and first.threads == 1
    recording = capsys.readouterr().err
    assert "cluster: estimate, 0 %" in recording and "cluster: estimate, 100 %" in recording


def test_results_survive_node_loss(nodes: Any, background: Any, tmp_path: Path) -> None:
    doomed = nodes.add_node(num_cpus=2)
    # Only that node has two cores.
    results = cluster.map(threads, [0], num_cpus=2, progress=False)
    assert results == ["2"]
    assert [(ran.node, ran.threads) for ran in results.ran if ran] == [(doomed.node_id, 2)]

    def begun_on_every_core(seed: int) -> dict[str, Any]:
        until(lambda: len(list(tmp_path.iterdir())) >= 4)
        return estimate_unit(seed)

    recording = RecordingFunction(tmp_path, begun_on_every_core)
    running = background(cluster.map, recording, range(4), progress=False)
    workers = until(lambda: [pid for _, pid, node in recording.tries() if node == doomed.node_id])
    started = until(lambda: [program for worker in workers for program in programs(worker)])
    nodes.remove_node(doomed, allow_graceful=False)
    until(lambda: not any(words(program) for program in started))
    results = running.result(timeout=120)
    assert len(recording.tries()) > 4, "its units were restarted"
    assert results == [estimate_unit(seed) for seed in range(4)]


def test_killed_worker_is_cleaned_up_and_retried(
    nodes: Any, background: Any, tmp_path: Path
) -> None:
    recording = RecordingFunction(tmp_path, estimate_unit)
    running = background(cluster.map, recording, [7], progress=False)
    _, worker, _ = until(recording.tries)[0]
    program = until(lambda: programs(worker))[0]
    os.kill(worker, signal.SIGKILL)
    until(lambda: not words(program), seconds=15)
    # Then only the program: the worker survives and the unit is retried.
    _, worker, _ = until(lambda: recording.tries()[1:])[0]
    os.kill(until(lambda: programs(worker))[0], signal.SIGKILL)
    assert running.result(timeout=60) == [estimate_unit(7)]
    assert len(recording.tries()) == 3


def dies(_item: object) -> None:
    """Kills its process."""
    os.kill(os.getpid(), signal.SIGKILL)


def test_limits_retries_of_crashing_unit(nodes: Any, tmp_path: Path) -> None:
    recording = RecordingFunction(tmp_path, dies)
    with pytest.raises(cluster.UnitFailed, match="unit 0 .*died"):
        cluster.map(recording, [0], tries=2, progress=False)
    assert len(recording.tries()) == 2


def halves(item: int) -> int:
    """Fails for odd numbers."""
    if item % 2:
        raise ValueError(f"{item} is odd")
    return item // 2


def test_exceptions_are_raised_or_returned_without_retry(nodes: Any) -> None:
    with pytest.raises(cluster.UnitFailed, match=r"unit 1 \(3\) failed: ValueError: 3 is odd") as failed:
        cluster.map(halves, [4, 3], progress=False)
    assert isinstance(failed.value.__cause__, ValueError)
    results = cluster.map(halves, [4, 3, 2], errors="return", progress=False)
    failure: object = results[1]
    assert isinstance(failure, cluster.UnitFailed) and failure.why == "ValueError: 3 is odd"
    assert (results[0], results[2]) == (2, 1)
    assert results.ran[1] is None
    with pytest.raises(cluster.UnitFailed, match="`iplw estimate .* ended with code 2: .*rounds"):
        cluster.run([["estimate", "--rounds", "0"]], progress=False)


def test_first_failure_cancels_others(nodes: Any, tmp_path: Path) -> None:
    def either(item: int) -> None:
        if item == 0:
            until(lambda: list(tmp_path.glob("1.*")))
            raise ValueError("enough")
        compute([[*LONG, "--preset=paper"]])

    recording = RecordingFunction(tmp_path, either)
    with pytest.raises(cluster.UnitFailed, match="enough"):
        cluster.map(recording, [1, 0], progress=False)
    worker = next(pid for item, pid, _ in recording.tries() if item == "1")
    until(lambda: not programs(worker))


def test_policy_file_is_sent_to_nodes(nodes: Any) -> None:
    train = command("train", task="basketball", per_task=40, batches=20, out="made/policy")
    weights = cluster.run([train, [train]], progress=False)
    assert weights[0].files == weights[1].files, "two nodes train bit-identical weights"
    assert list(weights[0].files) == ["made/policy"]
    policy = weights[0].files["made/policy"]
    results = cluster.evaluate(
        policy, "basketball", seeds=[1, 2], settings={"candidates": 200, "split": "validation"}, progress=False
    )
    assert [0.0 <= score["auccess"] <= 1.0 for score in results] == [True, True]
    evaluate = command("evaluate", task="basketball", policy="p", candidates=200, split="validation", seed=2, json=True)
    assert compute([evaluate], files={"p": policy}).json() == results[1]


def test_connects_by_address(nodes: Any, tmp_path: Path) -> None:
    sweep = Path(__file__).resolve().parents[3] / "examples" / "cluster" / "sweep.py"
    small = ["--task", "basketball", "--seeds", "2", "--rounds", "1", "--out", str(tmp_path / "sweep.csv")]
    remote = {**os.environ, "RAY_ADDRESS": nodes.address}
    run = subprocess.run([sys.executable, sweep, *small], env=remote, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "4 estimations" in run.stderr
    rows = [line.split(",") for line in (tmp_path / "sweep.csv").read_text().splitlines()[1:]]
    cells = [(damping, seed) for damping in ("0.8", "0.9") for seed in ("0", "1")]
    assert [(row[0], row[1]) for row in rows[::3]] == cells, "three latents in each"


def test_diagnose_runs_grid_of_worlds_and_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    request: list[Any] = []

    def recorded(commands: Any, *, threads: int) -> Output:
        request.append((commands, threads))
        return Output("", {"diagnosis/report.json": b'{"verdict": "explained"}'})

    monkeypatch.setattr(sweeps, "compute", recorded)
    monkeypatch.setattr(sweeps, "map", lambda work, items, **_: Results([work(i) for i in items], items, []))
    worlds = ["linear_drag:c=0.4", ["quadratic_drag:k=0.05", "linear_drag:c=0.2"]]
    results = cluster.diagnose("tossing", over={"effect": worlds}, seeds=[1, 2], settings={"trials": 4}, num_cpus=2)
    assert results.items == [{"effect": world, "seed": seed} for world in worlds for seed in (1, 2)]
    assert [report["verdict"] for report in results] == ["explained"] * 4
    (measure, diagnose), threads = request[3]
    assert threads == 2
    effects = ["--effect=quadratic_drag:k=0.05", "--effect=linear_drag:c=0.2"]
    assert measure == ["measure", "--task=tossing", "--trials=4", *effects, "--seed=2", "--out=measured"]
    trials = ["--scene=measured/scene.json", "--trials=measured/trials.csv"]
    assert diagnose == ["diagnose", *trials, "--seed=2", "--out=diagnosis"]
    with pytest.raises(ValueError, match="allowed: seeds="):
        cluster.diagnose("tossing", over={"seed": [1]})


def test_rejects_mixed_versions(nodes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = iplw.__version__
    monkeypatch.setattr(iplw, "__version__", "99.1.0")
    with pytest.raises(cluster.MixedVersions, match=f"has iplw {theirs} and this is iplw 99.1.0; install iplw==99.1.0"):
        cluster.map(halves, [4], errors="return", progress=False)


def test_detects_different_machines() -> None:
    machine = this_machine()
    wide = replace(machine, instructions="x86_64 avx512f fma avx2")

    def alike(**other: str) -> bool:
        machines = (wide, replace(wide, **other))
        return Results([1, 2], [1, 2], [Ran(one, "node", 1, 0.1) for one in machines]).alike

    assert alike(host="other", cpu="other") and alike(instructions="x86_64 fma avx2")
    # Trained weights differ without FMA.
    assert not alike(instructions="x86_64 avx2")
    assert not alike(libc="glibc 2.28") and not alike(build="0123456789ab")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"num_cpus": 0.5}, "num_cpus is 0.5; allowed: an integer from 1"),
        ({"tries": 0}, "tries is 0; allowed: an integer from 1"),
        ({"errors": "ignore"}, "errors is 'ignore'; allowed: 'raise' or 'return'"),
    ],
)
def test_rejects_invalid_options(options: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        cluster.map(halves, [2], **options)


def test_missing_ray_raises_only_on_use() -> None:
    asks = (
        "import sys; sys.modules['ray'] = None\n"
        "from iplw import cluster\n"
        "try: cluster.map(len, [''])\n"
        "except Exception as e: print(type(e).__name__, e)\n"
    )
    run = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True)
    assert run.stdout.startswith("IplwError iplw.cluster requires Ray: pip install 'iplw[ray]'")
