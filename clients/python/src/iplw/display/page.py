"""The card around all displays: colours for light and dark pages, and tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from .theme import custom_properties

#: Displayed rows of a table.
MAX_ROWS = 12

_DARK, _LIGHT = custom_properties(dark=True), custom_properties(dark=False)
#: Selectors of pages with an explicit colour scheme: JupyterLab, VS Code, Colab, mkdocs-material.
_DARK_SELECTORS = (
    '[data-jp-theme-light="false"]',
    ".vscode-dark",
    ".vscode-high-contrast",
    'html[theme="dark"]',
    '[data-md-color-scheme="slate"]',
)
_LIGHT_SELECTORS = '[data-jp-theme-light="true"]', ".vscode-light", 'html[theme="light"]', '[data-md-color-scheme="default"]'


def card(title: str, *parts: str, note: str = "") -> str:
    """A card with a title, a note and parts in HTML."""
    subtitle = f'<span class="n">{escape(note)}</span>' if note else ""
    return f'<div class="iplw">{STYLE}<div class="h"><b>{escape(title)}</b>{subtitle}</div>{"".join(parts)}</div>'


def document(title: str, *parts: str) -> str:
    """A page of its own with these parts in HTML."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width">\n<meta name="color-scheme" content="light dark">\n'
        f"</head>\n<body>\n{''.join(parts)}\n</body>\n</html>\n"
    )


def table(head: Sequence[str], rows: Iterable[Sequence[Any]], max_rows: int = MAX_ROWS) -> str:
    """A table of values; rows beyond `max_rows` are counted, not displayed."""
    rows = list(rows)
    cells = "".join("<tr>" + "".join(f"<td>{_cell(value)}</td>" for value in row) + "</tr>" for row in rows[:max_rows])
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    rest = f'<div class="n">and {len(rows) - max_rows} more</div>' if len(rows) > max_rows else ""
    return f"<table><thead><tr>{top}</tr></thead><tbody>{cells}</tbody></table>{rest}"


def paragraph(text: str) -> str:
    """A paragraph."""
    return f"<p>{escape(text)}</p>"


def preformatted(text: str) -> str:
    """Preformatted text."""
    return f"<pre>{escape(text)}</pre>"


def side_by_side(*parts: str) -> str:
    """Parts in one row, wrapped if necessary."""
    return f'<div class="r">{"".join(parts)}</div>'


def details(summary: str, part: str) -> str:
    """A part that is displayed when its summary is clicked."""
    return f"<details><summary>{escape(summary)}</summary>{part}</details>"


def number(value: Any) -> str:
    """A number with four digits; a dash for None and NaN."""
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return str(value)
    if isinstance(value, int):
        return str(value)
    return "–" if math.isnan(value) else "∞" if math.isinf(value) else f"{value:.4g}"


def interval(ends: Sequence[float | None] | None) -> str:
    """A 95 % interval; `unbounded` if an end is missing."""
    if ends is None or len(ends) != 2 or any(end is None for end in ends):
        return "unbounded"
    return f"{number(ends[0])} to {number(ends[1])}"


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return escape(number(value))


def _stylesheet() -> str:
    dark = ",".join(f"{selector} .iplw" for selector in _DARK_SELECTORS)
    unspecified = "".join(f":not({selector})" for selector in _LIGHT_SELECTORS)
    # Either `html` or `body` may carry the selector: the system preference applies only if neither is light.
    return (
        f".iplw{{{_LIGHT};color:var(--ink);background:var(--card);border:1px solid var(--line);border-radius:6px;"
        "padding:8px 12px;margin:4px 0;font:13px/1.45 system-ui,sans-serif;max-width:860px;overflow-x:auto}"
        f"@media(prefers-color-scheme:dark){{html{unspecified} body{unspecified} .iplw{{{_DARK}}}}}"
        f"{dark}{{{_DARK}}}"
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
        ".iplw .bar{height:6px;border-radius:3px;background:var(--line);overflow:hidden;margin:6px 0}"
        ".iplw .bar i{display:block;height:100%;background:var(--main)}"
        ".iplw pre{margin:4px 0;font:11px/1.5 ui-monospace,monospace;color:var(--soft);"
        "background:none;white-space:pre-wrap}"
    )


STYLE = f"<style>{_stylesheet()}</style>"
