"""Writes THIRD-PARTY.txt, the licences of everything inside the program: `python3 release/licences.py [--check]`.

`--check` changes nothing and fails where the file is not what would be written; which compiler builds the program, and
so which standard library is inside, does not count then.
"""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from parts import ROOT, Part, crates, others, standard_library

NAME = "THIRD-PARTY.txt"
_RULE = "=" * 100
_STANDARD = "\nThe standard library, and what is linked with it\n\n"


def main(arguments: list[str]) -> int:
    """Writes or checks."""
    path = ROOT / NAME
    if arguments == ["--check"]:
        made = text(crates(), others(), [])
        there = path.read_text(encoding="utf-8") if path.is_file() else ""
        if _compared(there) != _compared(made):
            print(f"{NAME} is not what Cargo.lock and web/package-lock.json ask for: run `make licences`", file=sys.stderr)
            return 1
        return 0
    made = text(crates(), others(), standard_library())
    path.write_text(made, encoding="utf-8")
    print(f"{NAME}: {len(made.encode()) / 1000:.0f} kB")
    return 0


def text(program: list[Part], brought: list[Part], standard: list[Part]) -> str:
    """The whole file: lists of what is inside, then each text once, below the names of those it is for."""
    head = """\
        What is inside the program `iplw` and is not ours, with the licences it comes under. Where a licence may be
        chosen, MIT is, and its text alone is given. Whoever passes the program on passes this file on with it.
        Made by `make licences`; the program's own licence is in LICENSE.
        """
    lists = [
        "\nCrates\n\n" + _list(program),
        "\nInside crates, and in the page\n\n" + _list(brought),
        _STANDARD + _list(standard),
    ]
    return textwrap.dedent(head) + "".join(lists) + _texts([*program, *brought]) + _STANDARD_TEXTS + _texts(standard)


_STANDARD_TEXTS = f"\n{_RULE}\n{_RULE}\nTexts of the standard library\n"


def _list(parts: list[Part]) -> str:
    return "".join(f"  {part.name} {part.version}: {part.licence}\n" for part in parts)


def _texts(parts: list[Part]) -> str:
    told: dict[str, tuple[str, list[str]]] = {}
    for part in parts:
        for body in part.texts:
            # Of the same words in other lines one is enough.
            told.setdefault(" ".join(body.split()), (body, []))[1].append(part.name)
    rows = []
    for body, names in told.values():
        clean = "\n".join(line.rstrip() for line in body.strip("\n\r").splitlines())
        heading = textwrap.fill(", ".join(dict.fromkeys(names)), 100, break_on_hyphens=False)
        rows.append(f"\n{_RULE}\n{heading}\n{_RULE}\n\n{clean}\n")
    return "".join(rows)


def _compared(whole: str) -> str:
    before, _, rest = whole.partition(_STANDARD)
    listed, _, _ = rest.partition(_STANDARD_TEXTS)
    return before + listed.partition(_RULE)[2]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
