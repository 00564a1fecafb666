"""The card that everything comes in: its colours, light and dark, and tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

#: Rows of a table that are shown; more would make a notebook heavy, and nobody reads them.
MOST_ROWS = 12

_DARK = "--ink:#e6edf3;--soft:#9da7b3;--line:#3d444d;--paper:#161b22;--fill:#262c36"
_DARK += ";--c0:#56d364;--c1:#6cb6ff;--c2:#ff7b72;--c3:#e3b341;--c4:#d2a8ff;--c5:#76e3ea"
_LIGHT = "--ink:#1f2328;--soft:#59636e;--line:#d1d9e0;--paper:#fff;--fill:#eff2f5"
_LIGHT += ";--c0:#1a7f37;--c1:#0969da;--c2:#cf222e;--c3:#9a6700;--c4:#8250df;--c5:#1b7c83"
#: Where a page says which it is, that counts: JupyterLab, VS Code, Colab, pages made with mkdocs-material.
_SAYS_DARK = (
    '[data-jp-theme-light="false"]',
    ".vscode-dark",
    ".vscode-high-contrast",
    'html[theme="dark"]',
    '[data-md-color-scheme="slate"]',
)
_SAYS_LIGHT = '[data-jp-theme-light="true"]', ".vscode-light", 'html[theme="light"]', '[data-md-color-scheme="default"]'


def card(title: str, *parts: str, note: str = "") -> str:
    """A card: a title, a note beside it, and parts that are HTML already."""
    beside = f'<span class="n">{escape(note)}</span>' if note else ""
    return f'<div class="iplw">{STYLE}<div class="h"><b>{escape(title)}</b>{beside}</div>{"".join(parts)}</div>'


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], most: int = MOST_ROWS) -> str:
    """A table of values; what is beyond `most` rows is counted, not shown."""
    rows = list(rows)
    cells = "".join("<tr>" + "".join(f"<td>{_cell(value)}</td>" for value in row) + "</tr>" for row in rows[:most])
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    rest = f'<div class="n">and {len(rows) - most} more</div>' if len(rows) > most else ""
    return f"<table><thead><tr>{top}</tr></thead><tbody>{cells}</tbody></table>{rest}"


def said(text: str) -> str:
    """A paragraph."""
    return f"<p>{escape(text)}</p>"


def preformatted(text: str) -> str:
    """Text as it stands."""
    return f"<pre>{escape(text)}</pre>"


def beside(*parts: str) -> str:
    """Parts beside each other, as many as fit."""
    return f'<div class="r">{"".join(parts)}</div>'


def folded(summary: str, part: str) -> str:
    """A part that is shown when its summary is clicked."""
    return f"<details><summary>{escape(summary)}</summary>{part}</details>"


def number(value: Any) -> str:
    """A number in four digits; a dash for none, `inf` in words a table can hold."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, int):
        return str(value)
    return "–" if math.isnan(value) else "∞" if math.isinf(value) else f"{value:.4g}"


def interval(ends: Sequence[float | None] | None) -> str:
    """A 95 % interval; one that has no ends is unbounded."""
    if ends is None or len(ends) != 2 or any(end is None for end in ends):
        return "unbounded"
    return f"{number(ends[0])} to {number(ends[1])}"


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return escape(number(value))


def _rules() -> str:
    by_page = ",".join(f"{where} .iplw" for where in _SAYS_DARK)
    silent = "".join(f":not({where})" for where in _SAYS_LIGHT)
    # `html` and `body` alike may say it: neither must say light for the system's wish to count.
    return (
        f".iplw{{{_LIGHT};color:var(--ink);background:var(--paper);border:1px solid var(--line);border-radius:6px;"
        "padding:8px 12px;margin:4px 0;font:13px/1.45 system-ui,sans-serif;max-width:860px;overflow-x:auto}"
        f"@media(prefers-color-scheme:dark){{html{silent} body{silent} .iplw{{{_DARK}}}}}"
        f"{by_page}{{{_DARK}}}"
        ".iplw .h{display:flex;gap:10px;align-items:baseline;flex-wrap:wrap;margin-bottom:4px}"
        ".iplw .n,.iplw summary{color:var(--soft)}.iplw p{margin:4px 0}"
        ".iplw .r{display:flex;flex-wrap:wrap;gap:12px;align-items:flex-start}"
        ".iplw table{border-collapse:collapse;margin:4px 0;color:inherit;background:none;font-size:12px}"
        ".iplw th,.iplw td{padding:2px 10px 2px 0;text-align:left!important;border:0;"
        "border-bottom:1px solid var(--line);"
        "background:none;color:inherit;font-variant-numeric:tabular-nums}"
        ".iplw th{font-weight:600;color:var(--soft)}"
        ".iplw svg{max-width:100%;height:auto}.iplw svg text{fill:var(--soft);font:11px system-ui,sans-serif}"
        ".iplw tbody tr,.iplw thead tr{background:none!important;text-align:left}"
        ".iplw .bar{height:6px;border-radius:3px;background:var(--fill);overflow:hidden;margin:6px 0}"
        ".iplw .bar i{display:block;height:100%;background:var(--c1)}"
        ".iplw pre{margin:4px 0;font:11px/1.5 ui-monospace,monospace;color:var(--soft);"
        "background:none;white-space:pre-wrap}"
    )


STYLE = f"<style>{_rules()}</style>"
