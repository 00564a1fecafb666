"""Markdown as the repository has it, made into what the pages are built from."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence

#: An item of a list: indentation, mark, text.
ITEM = re.compile(r"^( *)([-*]|\d+\.)( +)(?=\S)")
FENCE = re.compile(r"^ *(```+|~~~+)")
#: A link or picture: text, address.
LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^()\s]+)\)")
CODE = re.compile(r"(?<![`\[])`([^`\n]+)`(?![`\]])")


def outside_fences(text: str, change: Callable[[str], str]) -> str:
    """The text with `change` done to what is not in fences."""
    return "".join(change(part) if prose else part for prose, part in _parts(text))


def _parts(text: str) -> Iterator[tuple[bool, str]]:
    held: list[str] = []
    fence = ""
    for line in text.splitlines(keepends=True):
        result = FENCE.match(line)
        mark = result[1] if result else ""
        if not fence and mark:
            yield True, "".join(held)
            held, fence = [line], mark
        elif fence and mark.startswith(fence) and line.strip() == mark:
            yield False, "".join([*held, line])
            held, fence = [], ""
        else:
            held.append(line)
    yield not fence, "".join(held)


def four_spaces(text: str) -> str:
    """Lists and what is in them indented by fours, and a blank line before each: what Python-Markdown wants.

    GitHub's Markdown takes what belongs to an item from where its text begins, two or three signs in.
    """
    created: list[str] = []
    #: Where the text of each open item begins.
    open_: list[int] = []
    fence, blank = "", True
    for line in text.splitlines():
        result = FENCE.match(line)
        indent = len(line) - len(line.lstrip(" "))
        if not fence and line.strip():
            while open_ and indent < open_[-1] and (blank or ITEM.match(line) or result):
                open_.pop()
        item = None if fence else ITEM.match(line)
        depth = len(open_)
        if item:
            if not blank and not open_ and not (created and ITEM.match(created[-1].lstrip())):
                created.append("")
            created.append(" " * 4 * depth + item[2] + " " * max(1, 4 - len(item[2])) + line[item.end() :])
            open_.append(item.end())
        else:
            table = line.lstrip().startswith("|") and not blank and not created[-1].lstrip().startswith("|") and not fence
            if table:
                created.append("")
            within = max(0, indent - open_[-1]) if open_ else indent
            created.append((" " * (4 * depth + within) + line.lstrip(" ")) if line.strip() else "")
        if result:
            fence = "" if fence and line.strip() == fence else fence or result[1]
        blank = not line.strip() and not fence
    return "\n".join(created) + "\n"


def cell(text: str) -> str:
    """Text in one cell of a table."""
    return re.sub(r"\s*\n\s*", " ", text.strip()).replace("|", "\\|")


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A table; nothing without rows."""
    if not rows:
        return ""
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(cell, line))} |" for line in lines) + "\n"
