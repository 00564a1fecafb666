"""The package version, from Cargo.toml in a checkout or from the metadata of the wheel."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path


def package_version(package: Path = Path(__file__).resolve().parent) -> str:
    """The version of the package in this directory: of its checkout, else of the installed wheel."""
    for root in package.parents:
        manifest = root / "Cargo.toml"
        if manifest.is_file() and (root / "clients" / "python" / "src" / package.name) == package:
            match = re.search(r'^version = "([^"]+)"', manifest.read_text(encoding="utf-8"), re.MULTILINE)
            if match:
                return match[1]
    try:
        return distribution(package.name).version
    except PackageNotFoundError:
        return "0+unknown"
