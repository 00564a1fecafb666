"""Where the program `iplw` is: a private server is started from it, and `python -m iplw` runs it."""

from __future__ import annotations

import os
import shutil
import sysconfig
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from .errors import ServerUnavailable

HOW = (
    "`pip install iplw` brings it along; or build it with `cargo build --release` in the checkout, or name it with "
    "IPLW_BIN or iplw.Client(binary=...), or give the address of a running server with iplw.Client(url=...)"
)


def find_binary(binary: str | os.PathLike[str] | None = None) -> Path:
    """The program: the argument, else IPLW_BIN, else the wheel's own, else on PATH, else built in the checkout around us."""
    for source, given in (("binary", binary), ("IPLW_BIN", os.environ.get("IPLW_BIN"))):
        if given:
            path = Path(given).expanduser()
            found = shutil.which(path)
            if found is None:
                raise ServerUnavailable(f"{source} is {str(given)!r}, which is not an executable file; {HOW}")
            return Path(found).resolve()
    package = Path(__file__).resolve().parent
    ours = installed_with(package)
    if ours is not None:
        return ours
    on_path = shutil.which("iplw")
    if on_path is not None:
        return Path(on_path).resolve()
    built = _built_around(package)
    if built is not None:
        return built
    raise ServerUnavailable(f"no `iplw` binary found; {HOW}")


def installed_with(package: Path) -> Path | None:
    """The program that came in one wheel with the package in this directory, if it came in a wheel.

    What PATH has may be of another version, and an environment need not be activated.
    """
    site = package.parent
    name = PROGRAM
    try:
        wheel = distribution(package.name)
    except PackageNotFoundError:
        return None
    if Path(str(wheel.locate_file(""))).resolve() != site:
        return None  # A checkout, while a wheel is installed elsewhere.
    # Installers note where they put the command (environments, --user, --prefix), except `pip install --target`, which
    # moves everything afterwards.
    noted = [Path(str(wheel.locate_file(file))) for file in wheel.files or () if file.name == name]
    for path in (*noted, site / "bin" / name):
        if os.access(path, os.X_OK) and path.is_file():
            return path.resolve()
    return None


def _built_around(package: Path) -> Path | None:
    for root in package.parents:
        if (root / "Cargo.toml").is_file():
            built = [root / "target" / profile / PROGRAM for profile in ("release", "debug")]
            built = [path for path in built if os.access(path, os.X_OK)]
            if built:
                # Whichever was built last: the other may be from before what this package needs.
                return max(built, key=lambda path: path.stat().st_mtime)
    return None


#: The command's file name.
PROGRAM = "iplw" + (sysconfig.get_config_var("EXE") or "")
