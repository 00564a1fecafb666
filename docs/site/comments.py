"""Comments `#: ...` above an attribute or beside it, and pydantic's `Field(description=...)`, as docstrings of attributes.

An extension of griffe, which reads sources and knows the string below an attribute only.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import griffe


class Comments(griffe.Extension):
    """Gives attributes without a docstring the comment that speaks of them."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: dict[Path, list[str]] = {}

    def on_attribute_instance(self, *, node: ast.AST | griffe.ObjectNode, attr: griffe.Attribute, **_: Any) -> None:
        """Called by griffe for every attribute that it finds."""
        path = attr.filepath
        if attr.docstring is not None or attr.lineno is None or not isinstance(path, Path):
            return
        if path not in self._lines:
            self._lines[path] = path.read_text(encoding="utf-8").splitlines()
        if text := described(node) or comment_of(self._lines[path], attr.lineno - 1):
            attr.docstring = griffe.Docstring(text, parent=attr)


def described(node: ast.AST | griffe.ObjectNode) -> str:
    """What pydantic's `Field(description=...)` says."""
    value = getattr(node, "value", None)
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == "Field":
        for keyword in value.keywords:
            if keyword.arg == "description":
                return str(ast.literal_eval(keyword.value))
    return ""


def comment_of(lines: list[str], line: int) -> str:
    """What the comments at a line say: those above it, or the one at its end."""
    above: list[str] = []
    for text in reversed(lines[:line]):
        if not text.lstrip().startswith("#:"):
            break
        above.append(text.lstrip()[2:].strip())
    if above:
        return "\n".join(reversed(above))
    _, mark, beside = lines[line].partition("  #: ")
    return beside.strip() if mark else ""
