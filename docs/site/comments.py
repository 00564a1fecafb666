"""Comments `#: ...` above or after an attribute, and pydantic's `Field(description=...)`, as docstrings of attributes.

An extension of griffe, which by itself only reads the string below an attribute.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import griffe


class AttributeComments(griffe.Extension):
    """Uses an attribute's comment as its docstring if it has none."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: dict[Path, list[str]] = {}

    def on_attribute_instance(self, *, node: ast.AST | griffe.ObjectNode, attr: griffe.Attribute, **_: Any) -> None:
        """Called by griffe for every attribute."""
        path = attr.filepath
        if attr.docstring is not None or attr.lineno is None or not isinstance(path, Path):
            return
        if path not in self._lines:
            self._lines[path] = path.read_text(encoding="utf-8").splitlines()
        if text := field_description(node) or comment_of(self._lines[path], attr.lineno - 1):
            attr.docstring = griffe.Docstring(text, parent=attr)


def field_description(node: ast.AST | griffe.ObjectNode) -> str:
    """The description of pydantic's `Field(description=...)`."""
    value = getattr(node, "value", None)
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == "Field":
        for keyword in value.keywords:
            if keyword.arg == "description":
                return str(ast.literal_eval(keyword.value))
    return ""


def comment_of(lines: list[str], line: int) -> str:
    """The comment of a line: the lines above it, or the one at its end."""
    above: list[str] = []
    for text in reversed(lines[:line]):
        if not text.lstrip().startswith("#:"):
            break
        above.append(text.lstrip()[2:].strip())
    if above:
        return "\n".join(reversed(above))
    _, mark, trailing = lines[line].partition("  #: ")
    return trailing.strip() if mark else ""
