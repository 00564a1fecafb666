"""What is made from something else is as it would be made now; and no files import each other in a circle."""

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


@pytest.mark.parametrize("file", generate.made(), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_committed_is_what_would_be_made(file: Path) -> None:
    assert file.read_text() == generate.made()[file], "python clients/python/generate.py"


def test_nothing_made_is_left_over() -> None:
    left = set((PACKAGE / "sync").glob("*.py")) - set(generate.made())
    assert not left


def test_an_operation_needs_the_document_alone() -> None:
    said = {
        "operationId": "list_stars",
        "parameters": [{"name": "id", "in": "path"}, {"name": "limit", "in": "query"}],
        "responses": {"200": {"content": {"application/json": {"schema": {"$ref": "#/components/schemas/Stars"}}}}},
    }
    stars = {"properties": {"stars": {"type": "array"}, "next": {"type": "string"}}}
    document = {"paths": {"/v1/{id}/stars": {"get": said}}, "components": {"schemas": {"Stars": stars}}}
    table = generate.operations(document)
    assert '"list_stars": Operation(' in table and 'items="stars"' in table and 'names=("id", "limit")' in table


def imports_of(file: Path) -> set[Path]:
    """The package's own files that a file imports, anywhere in it and for whatever reason."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = file.parents[node.level - 1].joinpath(*(node.module.split(".") if node.module else ()))
            for path in (base, *(base / alias.name for alias in node.names)):
                for target in (path.with_suffix(".py"), path / "__init__.py"):
                    # `from . import a` imports `a`, not the package that we are in.
                    if target.is_file() and not (node.module is None and path == base):
                        found.add(target)
    return found


def test_no_files_import_each_other() -> None:
    graph = {file: imports_of(file) for file in PACKAGE.rglob("*.py")}
    assert PACKAGE / "transport.py" in graph[PACKAGE / "http.py"]
    while free := {file for file, used in graph.items() if not used & graph.keys()}:
        graph = {file: used for file, used in graph.items() if file not in free}
    assert not graph, {str(file.relative_to(PACKAGE)) for file in graph}


def test_the_table_of_families_is_the_servers(client: iplw.Client) -> None:
    assert (PACKAGE / "families.py").read_text() == generate.families(client.tasks()), "python generate.py --families"


def test_every_family_is_an_environment() -> None:
    assert FAMILIES and set(FAMILIES) <= set(gymnasium.registry)
