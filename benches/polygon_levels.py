"""Speed of polygons at each instruction set of this machine, one core, alternating.

    cargo bench --features levels --no-run --bench engines
    python benches/polygon_levels.py target/release/deps/engines-HASH [COPIES] [SCENE ...]

The scenes are `polygon_speed.py`'s, with COPIES (64) initial states each, with every step simulated (`full`) and with rollouts ended
at rest (`default`). Processor time of the library alone; median of three rounds. Prints microseconds per rollout step at the widest
level, and the relative speed of the other levels with its minimum and maximum over rounds.
"""

import argparse
import json
import math
import random
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from polygon_speed import ROUNDS, SCENES


def names():
    """`lanes` at every level of this machine, widest first; `-full` simulates every step."""
    listed = subprocess.run([sys.executable, Path(__file__).with_name("levels.py")], capture_output=True, text=True, check=True)
    return listed.stdout.split()


def measured(binary, file, engines):
    """Microseconds per step, by engine."""
    told = subprocess.run([binary, file, *engines], capture_output=True, text=True, check=True).stdout
    return {row["engine"]: row["us_per_step"] for row in map(json.loads, told.splitlines())}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary")
    parser.add_argument("copies", nargs="?", type=int, default=64)
    parser.add_argument("scenes", nargs="*", choices=[[], *SCENES], default=[])
    given = parser.parse_args()
    engines = names()
    kinds = {"full": [e for e in engines if e.endswith("-full")], "default": [e for e in engines if not e.endswith("-full")]}
    shares = {}
    for name in given.scenes or SCENES:
        draw = random.Random(name)
        with tempfile.NamedTemporaryFile("w", suffix=".jsonl") as file:
            file.writelines(json.dumps(SCENES[name](draw)) + "\n" for _ in range(given.copies))
            file.flush()
            rounds = [measured(given.binary, file.name, engines) for _ in range(ROUNDS)]
        for kind, (widest, *others) in kinds.items():
            line = f"{name:16}{kind:>9}  {widest} {statistics.median(r[widest] for r in rounds):.3f} us"
            for other in others:
                seen = [r[widest] / r[other] for r in rounds]
                shares.setdefault((kind, other), []).append(statistics.median(seen))
                line += f"   {other} {statistics.median(seen):.2f} ({min(seen):.2f} to {max(seen):.2f})"
            print(line, flush=True)
    for (kind, other), seen in shares.items():
        print(f"geometric mean, {kind}: {other} {math.exp(statistics.mean(map(math.log, seen))):.2f}")


if __name__ == "__main__":
    main()
