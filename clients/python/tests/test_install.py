"""Installation: the executable of the wheel, the version, declared dependencies."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import pytest

import iplw
from iplw import ServerUnavailable
from iplw.binary import PROGRAM, find_binary, binary_of_wheel
from iplw.version import package_version

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from develop import requirements  # noqa: E402

CHECKOUT = Path(__file__).resolve().parents[3]
PACKAGE = CHECKOUT / "clients" / "python" / "src" / "iplw"
METADATA = "Metadata-Version: 2.4\nName: iplw\nVersion: 9.8.7\n"


@pytest.fixture(name="pyproject")
def read_pyproject() -> dict[str, Any]:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    result: dict[str, Any] = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    return result


def _program(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('#!/bin/sh\necho "$0 $@"\n')
    path.chmod(0o755)
    return path.resolve()


def _installed(site: Path, recorded: str) -> Path:
    """A package as installed, with the path of the command in its RECORD."""
    package = site / "iplw"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    info = site / "iplw-9.8.7.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(METADATA)
    (info / "RECORD").write_text(f"iplw/__init__.py,,\n{recorded},,\niplw-9.8.7.dist-info/METADATA,,\n")
    return package


@pytest.mark.parametrize(
    ("site", "recorded", "location"),
    [
        ("lib/python3.11/site-packages", f"../../../bin/{PROGRAM}", "bin"),  # an environment, --user, --prefix
        ("target", f"../../bin/{PROGRAM}", "target/bin"),  # --target, whose RECORD is wrong
    ],
)
def test_finds_executable_of_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, site: str, recorded: str, location: str
) -> None:
    package = _installed(tmp_path / site, recorded)
    program = _program(tmp_path / location / PROGRAM)
    monkeypatch.syspath_prepend(str(package.parent))
    assert binary_of_wheel(package) == program
    assert package_version(package) == "9.8.7"
    program.unlink()
    assert binary_of_wheel(package) is None, "a wheel without executable is ignored"


def test_checkout_ignores_wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = _installed(tmp_path / "site", f"../bin/{PROGRAM}")
    _program(tmp_path / "bin" / PROGRAM)
    monkeypatch.syspath_prepend(str(package.parent))
    assert binary_of_wheel(PACKAGE) is None


def test_explicit_binary_has_precedence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    separate, named, argument, on_path = (_program(tmp_path / d / PROGRAM) for d in ("own", "named", "given", "path"))
    monkeypatch.setattr("iplw.binary.binary_of_wheel", lambda _: separate)
    monkeypatch.setenv("PATH", str(on_path.parent))
    monkeypatch.setenv("IPLW_BIN", str(named))
    assert find_binary(argument) == argument
    assert find_binary() == named
    monkeypatch.delenv("IPLW_BIN")
    assert find_binary() == separate, "preferred to PATH"
    monkeypatch.setattr("iplw.binary.binary_of_wheel", lambda _: None)
    assert find_binary() == on_path


def test_missing_executable_gives_install_hint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("IPLW_BIN", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("iplw.binary._checkout_build", lambda _: None)
    with pytest.raises(ServerUnavailable, match="pip install iplw"):
        find_binary()


def test_module_runs_executable(tmp_path: Path) -> None:
    environment = {**os.environ, "IPLW_BIN": str(_program(tmp_path / PROGRAM)), "PYTHONPATH": str(PACKAGE.parent)}
    command = [sys.executable, "-m", "iplw", "effects", "--json"]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.split() == [str(tmp_path / PROGRAM), "effects", "--json"]


def test_version_has_one_source(pyproject: dict[str, Any], client: iplw.Client) -> None:
    message = re.search(r'^version = "([^"]+)"', (CHECKOUT / "Cargo.toml").read_text(), re.MULTILINE)
    assert message is not None
    assert pyproject["project"]["dynamic"] == ["version"]
    assert "version" not in pyproject["project"]
    assert iplw.__version__ == message[1]
    run = subprocess.run([find_binary(), "--version"], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["iplw", message[1]]
    assert client.call("healthz")["version"] == message[1]
    document = json.loads((CHECKOUT / "openapi" / "openapi.json").read_text())
    assert document["info"]["version"] == message[1]


def test_unknown_version_of_loose_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> None:
        raise PackageNotFoundError

    monkeypatch.setattr("iplw.version.distribution", missing)
    assert package_version(tmp_path / "iplw") == "0+unknown"


#: Import name -> distribution name.
_INSTALLED_AS = {"IPython": "ipykernel", "PIL": "pillow", "openenv": "openenv-core", "sklearn": "scikit-learn", "zmq": "pyzmq"}


def test_imports_are_declared_dependencies(pyproject: dict[str, Any]) -> None:
    request = requirements(pyproject, pyproject["project"]["optional-dependencies"])
    names = {re.split(r"[^\w.-]", row, maxsplit=1)[0].lower() for row in request}
    for file, module in _imported():
        name = module.partition(".")[0]
        assert _INSTALLED_AS.get(name, name).lower().replace("_", "-") in names, f"{file.name} imports {name}"


def _imported() -> Iterator[tuple[Path, str]]:
    """Imports at module level; imports within functions may be optional."""
    for file in PACKAGE.rglob("*.py"):
        # The oldest supported Python.
        for node in ast.parse(file.read_text(), str(file), feature_version=(3, 10)).body:
            result = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                result = [node.module]
            ours = {*sys.stdlib_module_names, "iplw"}
            yield from ((file, module) for module in result if module.partition(".")[0] not in ours)


def test_extras_may_include_extras() -> None:
    extras = {"a": ["numpy"], "all": ["iplw[a, b]", "pandas>=2"], "b": ["iplw[a]", "ray"]}
    table: Mapping[str, Any] = {"name": "iplw", "dependencies": ["pillow"], "optional-dependencies": extras}
    assert requirements({"project": table}, ["all"]) == {"pillow", "numpy", "pandas>=2", "ray"}
    with pytest.raises(SystemExit, match="no extra 'c'; pyproject.toml has a, all, b"):
        requirements({"project": table}, ["c"])
