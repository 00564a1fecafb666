"""Converts a notebook to a page: its text, its code and its stored outputs."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

#: MIME types of outputs in order of preference -> file extension; None if the output is inlined.
MIME_TYPES: dict[str, str | None] = {
    "image/svg+xml": "svg",
    "image/png": "png",
    "text/html": None,
    "text/markdown": None,
    "text/plain": None,
}
ANSI = re.compile(r"\x1b\[[0-9;]*m")


def notebook_page(file: Path, page: Path) -> str:
    """The page's text; images are written next to `page`."""
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    parts = []
    for number, cell in enumerate(cells):
        source = _text(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        elif cell["cell_type"] == "code" and source.strip():
            parts.append(_fenced(source, "python"))
            for k, output in enumerate(cell.get("outputs", [])):
                parts.append(_output(output, page.with_name(f"{page.stem}-{number}-{k}")))
    return "\n\n".join(part for part in parts if part) + "\n"


def _output(output: dict[str, Any], name: Path) -> str:
    if output["output_type"] == "stream":
        # Progress bars on stderr are omitted.
        return _fenced(_text(output["text"]), "text") if output["name"] == "stdout" else ""
    if output["output_type"] == "error":
        return _fenced(ANSI.sub("", "\n".join(output["traceback"])), "text")
    data = output.get("data", {})
    kind = next((kind for kind in MIME_TYPES if kind in data), None)
    if kind is None:
        return ""
    text, extension = _text(data[kind]), MIME_TYPES[kind]
    if extension is not None:
        path = name.with_name(f"{name.name}.{extension}")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(text) if extension == "png" else text.encode())
        return f"![output]({path.name})"
    if kind == "text/html":
        return f'<div class="output">\n{text}\n</div>'
    return text if kind == "text/markdown" else _fenced(text, "text")


def _fenced(text: str, kind: str) -> str:
    fence = "````" if "```" in text else "```"
    return f"{fence}{kind}\n{text.rstrip()}\n{fence}"


def _text(lines: str | list[str]) -> str:
    return lines if isinstance(lines, str) else "".join(lines)
