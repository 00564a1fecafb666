"""Makes what of the client follows from something else: `python generate.py [--families]`, in a checkout.

| made | from |
|---|---|
| `src/iplw/operations.py` | `openapi/openapi.json`, itself made from the server's routes |
| `src/iplw/sync/` | `src/iplw/aio/`: the same methods, waiting where those are awaited |
| `src/iplw/families.py`, if asked for | the families of the server, `IPLW_BIN` or the checkout's latest build |
| the tables of `docs/environments.md`, likewise | the same |

Tests hold what is committed against what would be made.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import environments

HERE = Path(__file__).resolve().parent
PACKAGE = HERE / "src" / "iplw"
DOCUMENT = HERE.parents[1] / "openapi" / "openapi.json"
MADE = "Made by `generate.py` from"

_BODIES = {"text/csv": "csv", "application/octet-stream": "body"}


def made() -> dict[Path, str]:
    """Every file that is made of files, with its text."""
    sources = sorted((PACKAGE / "aio").glob("*.py"))
    return {
        PACKAGE / "operations.py": operations(json.loads(DOCUMENT.read_text())),
        **{PACKAGE / "sync" / source.name: waiting(source.name, source.read_text()) for source in sources},
    }


#: What asyncio says -> what waiting says, in code and in docstrings.
_WORDS = [
    (r"\basync (?=def|with|for)", ""),
    (r"\bawait ", ""),
    (r"\bAsync(?=[A-Z])", ""),
    (r"\baclosing\b", "closing"),
    (r"__a(?=enter__|exit__)", "__"),
    # Lines that only one of the two has.
    (r"(?m)^.*  # async\n", ""),
    (r"(?m)# sync: ", ""),
]


def waiting(name: str, source: str) -> str:
    """The source of a client that waits, of one that is awaited."""
    for awaited, waits in _WORDS:
        source = re.sub(awaited, waits, source)
    return f"# {MADE} `aio/{name}`; change that.\n{source}"


def operations(document: Mapping[str, Any]) -> str:
    """The table of operations, in the document's order; without streams, which are no calls."""
    rows = []
    for path, methods in document["paths"].items():
        for method, said in methods.items():
            row = _row(document, method, path, said)
            if "text/event-stream" not in row["gives"]:
                fields = "".join(f"        {name}={value!r},\n" for name, value in row.items() if value)
                rows.append(f'    "{said["operationId"]}": Operation(\n{fields}    ),\n')
    head = f'"""What the server can be asked for, named as in the OpenAPI document. {MADE} it."""\n\n'
    imports = "from __future__ import annotations\n\nfrom .operation import Operation\n\n"
    return f"{head}{imports}OPERATIONS: dict[str, Operation] = {{\n{''.join(rows)}}}\n".replace("'", '"')


def _row(document: Mapping[str, Any], method: str, path: str, said: Mapping[str, Any]) -> dict[str, Any]:
    """One operation's fields."""
    parameters = said.get("parameters", [])
    bodies = said.get("requestBody", {}).get("content", {})
    status, answer = next((code, answer) for code, answer in said["responses"].items() if code.startswith("2"))
    names = [p["name"] for p in parameters if p["in"] in ("path", "query")]
    for kind, body in bodies.items():
        names += [_BODIES[kind]] if kind in _BODIES else _properties(document, body["schema"])
    answers = answer.get("content", {})
    pages = _properties(document, answers.get("application/json", {}).get("schema", {}))
    return {
        "method": method.upper(),
        "path": path,
        "status": int(status),
        "names": tuple(dict.fromkeys(names)),
        "takes": tuple(bodies),
        "gives": tuple(answers),
        "keyed": any(p["name"] == "Idempotency-Key" for p in parameters),
        "items": _items(document, answers["application/json"]["schema"]) if "next" in pages else None,
    }


def _properties(document: Mapping[str, Any], schema: Mapping[str, Any]) -> list[str]:
    """Names of an object's properties."""
    return [name for part in _parts(document, schema) for name in part.get("properties", {})]


def _items(document: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """The one property that is a list."""
    (name,) = [
        name
        for part in _parts(document, schema)
        for name, property in part.get("properties", {}).items()
        if property.get("type") == "array"
    ]
    return str(name)


def _parts(document: Mapping[str, Any], schema: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """A schema and all that it is put together from."""
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    yield schema
    for how in ("allOf", "oneOf", "anyOf"):
        for part in schema.get(how, []):
            yield from _parts(document, part)


def families(known: Sequence[Mapping[str, Any]]) -> str:
    """The environments' ids, of the server's families in their order."""
    ids = {family["gymnasium"]: family["name"] for family in known}
    rows = "".join(f'    "{id}": "{name}",\n' for id, name in ids.items())
    head = f'"""Ids under which Gymnasium finds the environments -> families. {MADE} what the server says of them."""\n\n'
    return f"{head}from __future__ import annotations\n\nFAMILIES: dict[str, str] = {{\n{rows}}}\n"


def write(file: Path, text: str) -> None:
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)
    print(file.relative_to(HERE.parents[1]))


if __name__ == "__main__":
    for file, text in made().items():
        write(file, text)
    if "--families" in sys.argv:
        sys.path.insert(0, str(PACKAGE.parent))
        import iplw

        with iplw.Client() as client:
            known, told = environments.asked(client)
            write(PACKAGE / "families.py", families(known))
            write(environments.DOCUMENT, environments.document(environments.DOCUMENT.read_text(), known, told))
