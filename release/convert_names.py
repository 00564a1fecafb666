"""Converts files and shell scripts to the names of CHANGELOG.md, "Renamed": `python release/convert_names.py FILE...`, in place.

| file | change |
|---|---|
| posterior (`iplw.posterior/1`) | `unnamed` -> `discrepancy`, `config.follow` -> `config.sample_discrepancy`; becomes `iplw.posterior/2` |
| tokens (`iplw.tokens/1`, or a list of rows as in `IPLW_TOKENS`) | `may` -> `scope`; the checksum is dropped, and a server writes a new one |
| other text, such as shell scripts | options of `iplw` commands |

Files already in the new form are left as they are. Options are replaced only in commands that begin with `iplw` on the same line
or on lines continued by a backslash.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

#: Command -> old option -> new option.
OPTIONS = {
    "plan": {"--belief": "--posterior"},
    "design": {"--belief": "--posterior"},
    "train": {"--belief": "--posterior"},
    "agents": {"--beliefs": "--posteriors"},
    "estimate": {"--posterior": "--save-posterior"},
    "posterior": {"--follow": "--sample-discrepancy"},
    "token": {"--may": "--scope"},
    "mcp": {"--may": "--scope"},
    "experiment": {"--ways": "--acquisition"},
}
_COMMAND = re.compile(r"\biplw[ \t]+(" + "|".join(OPTIONS) + r")\b(?:\\\n|[^\n;|&])*")
_ROWS = re.compile(r"(--rows[ =])(\S+)")


def convert_posterior(document: dict[str, Any]) -> dict[str, Any]:
    """An `iplw.posterior/1` document as `iplw.posterior/2`."""
    renamed = {"discrepancy" if key == "unnamed" else key: value for key, value in document.items()}
    if "follow" in renamed.get("config", {}):
        config = renamed["config"].items()
        renamed["config"] = {"sample_discrepancy" if key == "follow" else key: value for key, value in config}
    return {**renamed, "format": "iplw.posterior/2"}


def convert_tokens(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of a token file."""
    return [{"scope" if key == "may" else key: value for key, value in row.items()} for row in rows]


def convert_script(text: str) -> str:
    """Options of `iplw` commands in a script."""

    def replace(match: re.Match[str]) -> str:
        command = match[0]
        for old, new in OPTIONS[match[1]].items():
            command = re.sub(rf"(?<=\s){old}(?=[\s=]|$)", new, command)
        if match[1] == "plan":
            command = _ROWS.sub(lambda rows: rows[1] + re.sub(r"\bbelief\b", "posterior", rows[2]), command)
        return command

    return _COMMAND.sub(replace, text)


def convert(text: str) -> str:
    """The text of a file in the new form."""
    try:
        document = json.loads(text)
    except ValueError:
        return convert_script(text)
    if isinstance(document, list) and document and all(isinstance(row, dict) and "may" in row for row in document):
        return json.dumps(convert_tokens(document)) + "\n"
    form = document.get("format") if isinstance(document, dict) else None
    if form == "iplw.posterior/1":
        return json.dumps(convert_posterior(document)) + "\n"
    if form == "iplw.tokens/1" and any("may" in row for row in document["tokens"]):
        return json.dumps({"format": form, "tokens": convert_tokens(document["tokens"])}, indent=2) + "\n"
    return text


def main(names: list[str]) -> None:
    """Converts the named files in place and prints those that changed."""
    if not names or names[0] in ("-h", "--help"):
        sys.exit(__doc__)
    for file in map(Path, names):
        text = file.read_text()
        converted = convert(text)
        if converted != text:
            # In place, so that a token file keeps its permissions.
            file.write_text(converted)
            print(file)


if __name__ == "__main__":
    main(sys.argv[1:])
