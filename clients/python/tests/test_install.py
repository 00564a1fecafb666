"""What an installation is: the wheel's own program is found, the version is said in one place, what is imported is asked for."""

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
from iplw.binary import PROGRAM, find_binary, installed_with
from iplw.version import own_version

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from develop import requirements  # noqa: E402

CHECKOUT = Path(__file__).resolve().parents[3]
PACKAGE = CHECKOUT / "clients" / "python" / "src" / "iplw"
METADATA = "Metadata-Version: 2.4\nName: iplw\nVersion: 9.8.7\n"


@pytest.fixture(name="pyproject")
def read_pyproject() -> dict[str, Any]:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    found: dict[str, Any] = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    return found


def _program(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('#!/bin/sh\necho "$0 $@"\n')
    path.chmod(0o755)
    return path.resolve()


def _installed(site: Path, noted: str) -> Path:
    """A package as an installer leaves it, with where its RECORD says that the command is."""
    package = site / "iplw"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    info = site / "iplw-9.8.7.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(METADATA)
    (info / "RECORD").write_text(f"iplw/__init__.py,,\n{noted},,\niplw-9.8.7.dist-info/METADATA,,\n")
    return package


@pytest.mark.parametrize(
    ("site", "noted", "there"),
    [
        ("lib/python3.11/site-packages", f"../../../bin/{PROGRAM}", "bin"),  # an environment, --user, --prefix
        ("target", f"../../bin/{PROGRAM}", "target/bin"),  # --target, whose RECORD is wrong
    ],
)
def test_a_wheels_own_program_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, site: str, noted: str, there: str
) -> None:
    package = _installed(tmp_path / site, noted)
    program = _program(tmp_path / there / PROGRAM)
    monkeypatch.syspath_prepend(str(package.parent))
    assert installed_with(package) == program
    assert own_version(package) == "9.8.7"
    program.unlink()
    assert installed_with(package) is None, "a wheel without its program is no reason to run nothing"


def test_a_checkout_does_not_take_a_wheels_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = _installed(tmp_path / "site", f"../bin/{PROGRAM}")
    _program(tmp_path / "bin" / PROGRAM)
    monkeypatch.syspath_prepend(str(package.parent))
    assert installed_with(PACKAGE) is None


def test_what_is_named_goes_before_what_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own, named, argument, on_path = (_program(tmp_path / d / PROGRAM) for d in ("own", "named", "given", "path"))
    monkeypatch.setattr("iplw.binary.installed_with", lambda _: own)
    monkeypatch.setenv("PATH", str(on_path.parent))
    monkeypatch.setenv("IPLW_BIN", str(named))
    assert find_binary(argument) == argument
    assert find_binary() == named
    monkeypatch.delenv("IPLW_BIN")
    assert find_binary() == own, "before PATH, which may have another version"
    monkeypatch.setattr("iplw.binary.installed_with", lambda _: None)
    assert find_binary() == on_path


def test_without_a_program_it_is_said_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("IPLW_BIN", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("iplw.binary._built_around", lambda _: None)
    with pytest.raises(ServerUnavailable, match="pip install iplw"):
        find_binary()


def test_the_module_runs_the_program(tmp_path: Path) -> None:
    environment = {**os.environ, "IPLW_BIN": str(_program(tmp_path / PROGRAM)), "PYTHONPATH": str(PACKAGE.parent)}
    command = [sys.executable, "-m", "iplw", "effects", "--json"]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert run.stdout.split() == [str(tmp_path / PROGRAM), "effects", "--json"]


def test_the_version_is_said_in_one_place(pyproject: dict[str, Any], client: iplw.Client) -> None:
    said = re.search(r'^version = "([^"]+)"', (CHECKOUT / "Cargo.toml").read_text(), re.MULTILINE)
    assert said is not None
    assert pyproject["project"]["dynamic"] == ["version"]
    assert "version" not in pyproject["project"]
    assert iplw.__version__ == said[1]
    run = subprocess.run([find_binary(), "--version"], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["iplw", said[1]]
    assert client.call("healthz")["version"] == said[1]
    document = json.loads((CHECKOUT / "openapi" / "openapi.json").read_text())
    assert document["info"]["version"] == said[1]


def test_a_package_that_lies_about_has_no_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> None:
        raise PackageNotFoundError

    monkeypatch.setattr("iplw.version.distribution", missing)
    assert own_version(tmp_path / "iplw") == "0+unknown"


#: Imported under another name than it is installed by.
_INSTALLED_AS = {"IPython": "ipykernel", "PIL": "pillow", "openenv": "openenv-core", "sklearn": "scikit-learn", "zmq": "pyzmq"}


def test_what_the_package_imports_is_asked_for(pyproject: dict[str, Any]) -> None:
    asked = requirements(pyproject, pyproject["project"]["optional-dependencies"])
    names = {re.split(r"[^\w.-]", row, maxsplit=1)[0].lower() for row in asked}
    for file, module in _imported():
        name = module.partition(".")[0]
        assert _INSTALLED_AS.get(name, name).lower().replace("_", "-") in names, f"{file.name} imports {name}"


def _imported() -> Iterator[tuple[Path, str]]:
    """What modules import as they are imported themselves; what a function imports may be somebody's own choice."""
    for file in PACKAGE.rglob("*.py"):
        # The oldest Python whose syntax may be used.
        for node in ast.parse(file.read_text(), str(file), feature_version=(3, 10)).body:
            found = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                found = [node.module]
            ours = {*sys.stdlib_module_names, "iplw"}
            yield from ((file, module) for module in found if module.partition(".")[0] not in ours)


def test_extras_may_name_extras() -> None:
    extras = {"a": ["numpy"], "all": ["iplw[a, b]", "pandas>=2"], "b": ["iplw[a]", "ray"]}
    table: Mapping[str, Any] = {"name": "iplw", "dependencies": ["pillow"], "optional-dependencies": extras}
    assert requirements({"project": table}, ["all"]) == {"pillow", "numpy", "pandas>=2", "ray"}
    with pytest.raises(SystemExit, match="no extra 'c'; pyproject.toml has a, all, b"):
        requirements({"project": table}, ["c"])
