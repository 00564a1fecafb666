"""A short hold of the server by many clients; `benches/hold.py --seconds 300` is the long one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from iplw.binary import find_binary

CHECKOUT = Path(__file__).resolve().parents[3]


def test_many_clients_at_once() -> None:
    # The time is too short for memory to have settled: growth is only bounded, not flat.
    command = ["--bin", str(find_binary()), "--seconds", "10", "--growth", "0.5"]
    done = subprocess.run(
        [sys.executable, str(CHECKOUT / "benches" / "hold.py"), *command], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout)
    assert figures["errors"] == 0 and figures["sessions"] >= 1000 and figures["requests"] > 1000
    # Each thread keeps a stack and an arena: as many as a busy machine would make are most of what memory grows by.
    assert figures["threads"] <= 90, figures
