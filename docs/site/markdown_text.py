"""Converts the repository's Markdown (GitHub) to that of the site (Python-Markdown)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

#: A list item: indentation, marker, text.
ITEM = re.compile(r"^( *)([-*]|\d+\.)( +)(?=\S)")
FENCE = re.compile(r"^ *(```+|~~~+)")
#: A link or image: text, address.
LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^()\s]+)\)")
CODE = re.compile(r"(?<![`\[])`([^`\n]+)`(?![`\]])")


def outside_fences(text: str, change: Callable[[str], str]) -> str:
    """Applies `change` to the text outside fences."""
    return "".join(change(part) if prose else part for prose, part in _parts(text))


def _parts(text: str) -> Iterator[tuple[bool, str]]:
    pending: list[str] = []
    fence = ""
    for line in text.splitlines(keepends=True):
        result = FENCE.match(line)
        mark = result[1] if result else ""
        if not fence and mark:
            yield True, "".join(pending)
            pending, fence = [line], mark
        elif fence and mark.startswith(fence) and line.strip() == mark:
            yield False, "".join([*pending, line])
            pending, fence = [], ""
        else:
            pending.append(line)
    yield not fence, "".join(pending)


def normalize_lists(text: str) -> str:
    """Indents list contents by four spaces, and adds a blank line before lists, as Python-Markdown requires.

    GitHub's Markdown indents an item's contents to the start of its text, by two or three spaces.
    """
    output: list[str] = []
    #: Column at which the text of each open item begins.
    open_items: list[int] = []
    fence, blank = "", True
    for line in text.splitlines():
        result = FENCE.match(line)
        indent = len(line) - len(line.lstrip(" "))
        if not fence and line.strip():
            while open_items and indent < open_items[-1] and (blank or ITEM.match(line) or result):
                open_items.pop()
        item = None if fence else ITEM.match(line)
        depth = len(open_items)
        if item:
            if not blank and not open_items and not (output and ITEM.match(output[-1].lstrip())):
                output.append("")
            output.append(" " * 4 * depth + item[2] + " " * max(1, 4 - len(item[2])) + line[item.end() :])
            open_items.append(item.end())
        else:
            table = line.lstrip().startswith("|") and not blank and not output[-1].lstrip().startswith("|") and not fence
            if table:
                output.append("")
            within = max(0, indent - open_items[-1]) if open_items else indent
            output.append((" " * (4 * depth + within) + line.lstrip(" ")) if line.strip() else "")
        if result:
            fence = "" if fence and line.strip() == fence else fence or result[1]
        blank = not line.strip() and not fence
    return "\n".join(output) + "\n"


def cell(text: str) -> str:
    """Escapes text for a table cell."""
    return re.sub(r"\s*\n\s*", " ", text.strip()).replace("|", "\\|")


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A table; empty without rows."""
    if not rows:
        return ""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(cell, line))} |" for line in lines) + "\n"
