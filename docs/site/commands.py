"""The command line as a page: what `--help` of each command says."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

#: A command in a list of commands, `  serve   Serve worlds`.
ROW = re.compile(r"^  ([a-z][a-z-]*)(?:  |$)", re.MULTILINE)


def commands_page(binary: Path) -> str:
    """The page; every command of every list has its part."""
    parts = ["# Command line\n\nWhat `iplw --help` and `iplw COMMAND --help` say.\n"]
    for words, text in all_help(binary, ()):
        level = "##" if len(words) < 2 else "###"
        parts.append(f"\n{level} {' '.join(('iplw', *words))}\n\n```text\n{text.strip()}\n```\n")
    return "".join(parts)


def all_help(binary: Path, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """Every command with its help, the program itself first."""
    text = subprocess.run([binary, *words, "--help"], capture_output=True, text=True, check=True).stdout
    # It calls itself as its file is called.
    yield words, text.replace(f"Usage: {binary.name}", "Usage: iplw")
    _, mark, listed = text.partition("\nCommands:\n")
    for name in ROW.findall(listed.partition("\n\n")[0]) if mark else []:
        if name != "help":
            yield from all_help(binary, (*words, name))
