"""The page of the command line: `--help` of every command."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

#: A row of a list of commands, `  serve   Serve worlds`.
COMMAND_ROW = re.compile(r"^  ([a-z][a-z-]*)(?:  |$)", re.MULTILINE)


def commands_page(binary: Path) -> str:
    """The page, with a section for every command."""
    parts = ["# Command line\n\nThe output of `iplw --help` and `iplw COMMAND --help`.\n"]
    for words, text in all_help(binary, ()):
        level = "##" if len(words) < 2 else "###"
        parts.append(f"\n{level} {' '.join(('iplw', *words))}\n\n```text\n{text.strip()}\n```\n")
    return "".join(parts)


def all_help(binary: Path, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str]]:
    """All commands with their help, the program itself first."""
    text = subprocess.run([binary, *words, "--help"], capture_output=True, text=True, check=True).stdout
    # The usage line contains the name of the executable.
    yield words, text.replace(f"Usage: {binary.name}", "Usage: iplw")
    _, mark, listed = text.partition("\nCommands:\n")
    for name in COMMAND_ROW.findall(listed.partition("\n\n")[0]) if mark else []:
        if name != "help":
            yield from all_help(binary, (*words, name))
