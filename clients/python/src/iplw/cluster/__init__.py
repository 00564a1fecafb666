"""Many machines: whole units of work (seconds to minutes) on the nodes of a Ray cluster. `pip install 'iplw[ray]'`.

    from iplw import cluster

    found = cluster.estimate("bowling", seeds=range(16), settings={"preset": "paper"})  # a list of reports
    found = cluster.diagnose("basketball", over={"effect": ["linear_drag:c=1", "wind:ax=1"]}, seeds=range(4))
    found = cluster.run([["experiment", "harder", "--worlds", w, "--out", "out"] for w in worlds])
    found = cluster.map(function, items)                                    # any function of yours

Results come in the order of what was asked and are the same to the bit, whatever the number of nodes, the order in
which units end, and what dies meanwhile; `found.ran` says where each was computed, `found.alike` whether those
machines and programs were of one kind. A unit whose process or node is killed is tried again elsewhere, and nothing
that it started outlives it. A unit computes with `num_cpus` threads. Programs of different versions are not mixed.

Without an address, Ray's own rules hold: RAY_ADDRESS, or a small cluster on this machine.

| file | what |
|---|---|
| `sweeps` | estimations, evaluations, diagnoses, any command |
| `mapped` | units as Ray tasks |
| `results`, `place` | what comes back, and where it was computed |
| `connect` | Ray, if it is installed |

Only these files name Ray; `iplw.unit` runs a unit without it.
"""

from ..unit import Output, command
from .mapped import MixedVersions, UnitFailed, map
from .place import Ran
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
