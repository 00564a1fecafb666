"""Locates the `iplw` executable, for the private server and for `python -m iplw`."""

from __future__ import annotations

import os
import shutil
import sysconfig
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from .errors import ServerUnavailable

INSTALL_HINT = (
    "install it with `pip install iplw`, build it with `cargo build --release` in the checkout, set IPLW_BIN or "
    "iplw.Client(binary=...), or connect to a running server with iplw.Client(url=...)"
)


def find_binary(binary: str | os.PathLike[str] | None = None) -> Path:
    """The executable: from the argument, IPLW_BIN, the wheel, PATH, or a build in the enclosing checkout, in this order."""
    for source, value in (("binary", binary), ("IPLW_BIN", os.environ.get("IPLW_BIN"))):
        if value:
            path = Path(value).expanduser()
            found = shutil.which(path)
            if found is None:
                raise ServerUnavailable(f"{source} is {str(value)!r}, which is not an executable file; {INSTALL_HINT}")
            return Path(found).resolve()
    package = Path(__file__).resolve().parent
    wheel_binary = binary_of_wheel(package)
    if wheel_binary is not None:
        return wheel_binary
    on_path = shutil.which("iplw")
    if on_path is not None:
        return Path(on_path).resolve()
    build = _checkout_build(package)
    if build is not None:
        return build
    raise ServerUnavailable(f"no `iplw` binary found; {INSTALL_HINT}")


def binary_of_wheel(package: Path) -> Path | None:
    """The executable installed by the same wheel as the package in this directory, if any.

    It is preferred to PATH, which may hold another version; the environment need not be activated.
    """
    site = package.parent
    name = PROGRAM
    try:
        wheel = distribution(package.name)
    except PackageNotFoundError:
        return None
    if Path(str(wheel.locate_file(""))).resolve() != site:
        return None  # This package is a checkout; a wheel is installed elsewhere.
    # Installers record the path of the command (environments, --user, --prefix), except `pip install --target`, which
    # moves files afterwards.
    recorded = [Path(str(wheel.locate_file(file))) for file in wheel.files or () if file.name == name]
    for path in (*recorded, site / "bin" / name):
        if os.access(path, os.X_OK) and path.is_file():
            return path.resolve()
    return None


def _checkout_build(package: Path) -> Path | None:
    for root in package.parents:
        if (root / "Cargo.toml").is_file():
            build = [root / "target" / profile / PROGRAM for profile in ("release", "debug")]
            build = [path for path in build if os.access(path, os.X_OK)]
            if build:
                # The latest build: an older one may lack features that this package needs.
                return max(build, key=lambda path: path.stat().st_mtime)
    return None


#: File name of the executable.
PROGRAM = "iplw" + (sysconfig.get_config_var("EXE") or "")
