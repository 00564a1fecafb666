"""Run in a fresh environment with the wheel just installed: does it do what it is for? Prints one JSON object.

Only what the wheel brings may be used; where the package is imported from is told, so that a checkout cannot stand in.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
import urllib.request
from typing import Any

STARTED = time.perf_counter()


def main() -> None:
    """Steps once, asks the page and the command, and tells times in s."""
    import gymnasium

    import iplw
    from iplw.binary import find_binary

    env = gymnasium.make("iplw/Bowling-v0", world="sim")
    env.reset(seed=1)
    while not env.step(env.action_space.sample())[4]["valid"]:
        pass
    told: dict[str, Any] = {"python": sys.version.split()[0], "first_step_s": time.perf_counter() - STARTED}
    env.close()
    with iplw.Client("private") as client:
        health = client.call("healthz")
        address = client.url
        told["page"] = "<title>iplw" in _page(f"{address}/") and len(_page(f"{address}/assets/app.js")) > 100_000
    program = find_binary()
    module = subprocess.run([sys.executable, "-m", "iplw", "--version"], capture_output=True, text=True, check=True)
    command = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    told |= {
        "package": iplw.__file__,
        "program": str(program),
        "versions": sorted({iplw.__version__, health["version"], module.stdout.split()[1], command.stdout.split()[1]}),
    }
    print(json.dumps(told))


def _page(address: str) -> str:
    asked = urllib.request.Request(address, headers={"Accept": "text/html, */*"})
    with urllib.request.urlopen(asked, timeout=10) as answer:
        text: str = answer.read().decode()
    return text


if __name__ == "__main__":
    main()
