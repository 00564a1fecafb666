"""Which version this is. Cargo.toml alone says it; wheels carry it in their metadata."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path


def own_version(package: Path = Path(__file__).resolve().parent) -> str:
    """The version of the package in this directory: its checkout's, if it is in one, else the installed wheel's."""
    for root in package.parents:
        manifest = root / "Cargo.toml"
        if manifest.is_file() and (root / "clients" / "python" / "src" / package.name) == package:
            found = re.search(r'^version = "([^"]+)"', manifest.read_text(encoding="utf-8"), re.MULTILINE)
            if found:
                return found[1]
    try:
        return distribution(package.name).version
    except PackageNotFoundError:
        return "0+unknown"
