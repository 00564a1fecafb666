"""A short load test with many clients; `benches/hold.py --seconds 300` is the long one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from iplw.binary import find_binary

CHECKOUT = Path(__file__).resolve().parents[3]


def test_many_concurrent_clients() -> None:
    # Too short for memory to reach a steady state: growth is only bounded.
    command = ["--bin", str(find_binary()), "--seconds", "10", "--growth", "0.5"]
    done = subprocess.run(
        [sys.executable, str(CHECKOUT / "benches" / "hold.py"), *command], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout)
    assert figures["errors"] == 0 and figures["sessions"] >= 1000 and figures["requests"] > 1000
    # Each thread keeps a stack and an arena, which dominate the growth of memory.
    assert figures["threads"] <= 90, figures
