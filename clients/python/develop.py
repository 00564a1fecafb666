"""Sets up a virtual environment for development of the package: `VENV/bin/python develop.py [EXTRA ...]`.

Installs the dependencies in pyproject.toml and makes `import iplw` find the sources here. `pip install -e .` would also
compile the program as a release, which takes minutes; for work on the Python code any `iplw` executable will do
(`iplw.binary`).
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
    """Installs the dependencies and adds the sources to the import path."""
    if sys.prefix == sys.base_prefix:
        print("error: run this with the Python of a virtual environment", file=sys.stderr)
        return 2
    import tomllib  # Python 3.11: required for development only.

    needed = sorted(requirements(tomllib.loads(PYPROJECT.read_text(encoding="utf-8")), extras))
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, *needed], check=True)
    path = Path(sysconfig.get_path("purelib")) / "iplw.pth"
    path.write_text(f"{HERE / 'src'}\n", encoding="utf-8")
    return 0


def requirements(pyproject: dict[str, Any], extras: Iterable[str]) -> set[str]:
    """Dependencies of the package with these extras; extras that refer to others (`iplw[ray]`) are resolved."""
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
