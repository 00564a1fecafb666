"""Makes the environment that runs this one for work on the package: `VENV/bin/python develop.py [EXTRA ...]`.

What pyproject.toml asks for is installed, and `import iplw` finds the sources here. `pip install -e .` would compile
the program as well, for minutes and as a release; for work on the Python side any `iplw` will do (`iplw.binary`).
"""

from __future__ import annotations

import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PYPROJECT = HERE.parents[1] / "pyproject.toml"


def main(extras: list[str]) -> int:
    """Installs, then says where the package is imported from."""
    if sys.prefix == sys.base_prefix:
        print("error: run this with the Python of a virtual environment", file=sys.stderr)
        return 2
    import tomllib  # Python 3.11: work on the package needs it, the package does not.

    needed = sorted(requirements(tomllib.loads(PYPROJECT.read_text(encoding="utf-8")), extras))
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, *needed], check=True)
    path = Path(sysconfig.get_path("purelib")) / "iplw.pth"
    path.write_text(f"{HERE / 'src'}\n", encoding="utf-8")
    return 0


def requirements(pyproject: dict[str, Any], extras: Iterable[str]) -> set[str]:
    """What the package needs with these extras; extras that name others of ours (`iplw[ray]`) are followed."""
    project = pyproject["project"]
    return {*project["dependencies"], *(row for extra in extras for row in _extra(project, extra))}


def _extra(project: dict[str, Any], name: str) -> Iterator[str]:
    table: dict[str, list[str]] = project["optional-dependencies"]
    if name not in table:
        raise SystemExit(f"error: no extra {name!r}; pyproject.toml has {', '.join(table)}")
    for row in table[name]:
        ours = re.fullmatch(rf"{project['name']}\[([\w, -]+)\]", row)
        if ours is None:
            yield row
        else:
            for other in ours[1].split(","):
                yield from _extra(project, other.strip())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
