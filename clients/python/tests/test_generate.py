"""Generated files are up to date, and there are no import cycles."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import gymnasium
import pytest

import iplw
from iplw.families import FAMILIES

CLIENT = Path(__file__).resolve().parents[1]
PACKAGE = CLIENT / "src" / "iplw"
sys.path.insert(0, str(CLIENT))

import generate  # noqa: E402


@pytest.mark.parametrize("file", generate.generated_files(), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_generated_files_are_up_to_date(file: Path) -> None:
    assert file.read_text() == generate.generated_files()[file], "python clients/python/generate.py"


def test_no_stale_generated_files() -> None:
    remaining = set((PACKAGE / "sync").glob("*.py")) - set(generate.generated_files())
    assert not remaining


def test_operations_from_document() -> None:
    message = {
        "operationId": "list_stars",
        "parameters": [{"name": "id", "in": "path"}, {"name": "limit", "in": "query"}],
        "responses": {"200": {"content": {"application/json": {"schema": {"$ref": "#/components/schemas/Stars"}}}}},
    }
    stars = {"properties": {"stars": {"type": "array"}, "next": {"type": "string"}}}
    document = {"paths": {"/v1/{id}/stars": {"get": message}}, "components": {"schemas": {"Stars": stars}}}
    table = generate.operations(document)
    assert '"list_stars": Operation(' in table and 'list_field="stars"' in table and 'arguments=("id", "limit")' in table


def imports_of(file: Path) -> set[Path]:
    """The modules of the package that a file imports anywhere."""
    result = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = file.parents[node.level - 1].joinpath(*(node.module.split(".") if node.module else ()))
            for path in (base, *(base / alias.name for alias in node.names)):
                for target in (path.with_suffix(".py"), path / "__init__.py"):
                    # `from . import a` imports `a`, not this package.
                    if target.is_file() and not (node.module is None and path == base):
                        result.add(target)
    return result


def test_no_import_cycles() -> None:
    graph = {file: imports_of(file) for file in PACKAGE.rglob("*.py")}
    assert PACKAGE / "transport.py" in graph[PACKAGE / "http.py"]
    while free := {file for file, used in graph.items() if not used & graph.keys()}:
        graph = {file: used for file, used in graph.items() if file not in free}
    assert not graph, {str(file.relative_to(PACKAGE)) for file in graph}


def test_families_are_up_to_date() -> None:
    with iplw.Client("private", collections=generate.COLLECTIONS) as client:
        expected = generate.families(generate.families_by_collection(client), client.control_tasks())
    assert (PACKAGE / "families.py").read_text() == expected, "python generate.py --families"


def test_families_are_registered() -> None:
    assert len(FAMILIES) == 37 and set(FAMILIES) <= set(gymnasium.registry)
