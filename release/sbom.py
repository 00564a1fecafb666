"""A bill of materials (CycloneDX): what maturin notes of the crates, and what crates and the page bring along."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

from parts import Part, others, standard_library


def write(wheel: Path, to: Path) -> int:
    """Writes the bill of a wheel, held against the standard's schema; returns how many components it has."""
    with zipfile.ZipFile(wheel) as packed:
        (name,) = (name for name in packed.namelist() if ".dist-info/sboms/" in name and name.endswith(".json"))
        bill = json.loads(packed.read(name))
    there = {component.get("purl", "").partition("?")[0] for component in bill["components"]}
    added = [part for part in (*others(), *standard_library()) if part.purl not in there]
    bill["components"] += [_component(part) for part in added]
    _hang(bill, [part.purl for part in added])
    text = json.dumps(bill, indent=1) + "\n"
    _held_against_its_schema(text, bill["specVersion"])
    to.write_text(text, encoding="utf-8")
    return len(bill["components"])


def _component(part: Part) -> dict[str, Any]:
    return {
        "type": "library",
        "bom-ref": part.purl,
        "name": part.name,
        "version": part.version,
        "licenses": [{"expression": part.licence}],
        "purl": part.purl,
    }


def _hang(bill: dict[str, Any], added: list[str]) -> None:
    """All of it is in the program itself, whichever crate brought it."""
    root = bill["metadata"]["component"]["bom-ref"]
    (row,) = (row for row in bill["dependencies"] if row["ref"] == root)
    row["dependsOn"] = [*row.get("dependsOn", ()), *added]


def _held_against_its_schema(text: str, version: str) -> None:
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    wrong = JsonStrictValidator(SchemaVersion.from_version(version)).validate_str(text)
    if wrong is not None:
        raise ValueError(f"the bill of materials breaks CycloneDX {version}: {wrong}")
