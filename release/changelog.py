"""Whether the version that Cargo.toml says is the one that CHANGELOG.md tells of, in the form of Keep a Changelog."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from parts import ROOT

KINDS = ("Added", "Changed", "Deprecated", "Removed", "Fixed", "Security")


@dataclass(frozen=True)
class Section:
    """`## [1.2.3] - 2026-11-25` or `## [Unreleased]`, with its kinds of changes."""

    version: str
    date: str | None
    kinds: list[str] = field(default_factory=list)
    #: Entries, each a row that starts with a dash.
    entries: int = 0


def checked(final: bool) -> str:
    """Says what would be released, or raises `ValueError` with what is wrong.

    A draft may have entries under *Unreleased*; what is final may not, and its section is the newest.
    """
    said = version()
    sections = read((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    if not sections or sections[0].version != "Unreleased":
        raise ValueError("CHANGELOG.md has to start with a section [Unreleased]")
    ahead, released = sections[0], sections[1:]
    newest = released[0].version if released else "nothing"
    if newest != said:
        raise ValueError(f"Cargo.toml says {said}; the newest section of CHANGELOG.md is {newest}")
    if ahead.entries and final:
        raise ValueError(f"{ahead.entries} entries of CHANGELOG.md are unreleased: give them a version and a date")
    if ahead.entries:
        return f"a draft: {said} and {ahead.entries} unreleased changes"
    return f"{said} of {released[0].date}"


def version() -> str:
    """What Cargo.toml says."""
    found = re.search(r'^version = "([^"]+)"', (ROOT / "Cargo.toml").read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise ValueError("Cargo.toml says no version")
    return found[1]


def read(text: str) -> list[Section]:
    """The sections, newest first; a `ValueError` names a heading that is none."""
    sections: list[Section] = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("## "):
            sections.append(_section(number, line))
        elif line.startswith("### "):
            if line[4:] not in KINDS or not sections:
                raise ValueError(f"CHANGELOG.md:{number} is {line!r}; allowed: {', '.join(KINDS)}, below a version")
            sections[-1].kinds.append(line[4:])
        elif line.startswith("- ") and sections:
            last = sections.pop()
            sections.append(Section(last.version, last.date, last.kinds, last.entries + 1))
    dates = [section.date for section in sections if section.date]
    if dates != sorted(dates, reverse=True):
        raise ValueError("CHANGELOG.md: the newest version stands first")
    return sections


def _section(number: int, line: str) -> Section:
    if line == "## [Unreleased]":
        return Section("Unreleased", None)
    found = re.fullmatch(r"## \[(\d+\.\d+\.\d+(?:-[\w.]+)?)\] - (\d{4}-\d{2}-\d{2})", line)
    if found is None:
        raise ValueError(f"CHANGELOG.md:{number} is {line!r}; allowed: ## [Unreleased] or ## [1.2.3] - 2026-11-25")
    return Section(found[1], found[2])
