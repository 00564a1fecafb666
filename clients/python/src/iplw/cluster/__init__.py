"""Runs units of work (seconds to minutes) on the nodes of a Ray cluster. `pip install 'iplw[ray]'`.

    from iplw import cluster

    results = cluster.estimate("bowling", seeds=range(16), settings={"preset": "paper"})  # a list of reports
    results = cluster.diagnose("basketball", over={"effect": ["linear_drag:c=1", "wind:ax=1"]}, seeds=range(4))
    results = cluster.run([["experiment", "harder", "--worlds", w, "--out", "out"] for w in worlds])
    results = cluster.map(function, items)                                    # any function

Results have the order of the inputs and are bit-identical for any number of nodes, order of completion and failures on
the way; `results.ran` says where each was computed, `results.alike` whether those machines and programs were of one kind.
A unit whose process or node is killed is retried on another node, and its subprocesses end with it. A unit computes with
`num_cpus` threads. Programs of different versions are not mixed.

Without an address, Ray's defaults apply: RAY_ADDRESS, or a local cluster.

| module | contents |
|---|---|
| `sweeps` | estimations, evaluations, diagnoses, any command |
| `parallel` | units as Ray tasks |
| `results`, `machine` | results, and the machines that computed them |
| `connect` | connects to Ray, if it is installed |

Only these modules use Ray; `iplw.cli` runs a unit without it.
"""

from ..cli import Output, command
from .parallel import MixedVersions, UnitFailed, map
from .machine import Ran
from .results import Results
from .sweeps import diagnose, estimate, evaluate, run

__all__ = [
    "MixedVersions",
    "Output",
    "Ran",
    "Results",
    "UnitFailed",
    "command",
    "diagnose",
    "estimate",
    "evaluate",
    "map",
    "run",
]
