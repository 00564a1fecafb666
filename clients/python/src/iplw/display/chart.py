"""Small charts as SVG: lines, intervals, bars. `iplw.plot` draws figures with full axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TypeAlias

from .page import number

#: A line: its name and (x, y) points; non-finite points are omitted.
Line: TypeAlias = "tuple[str, Sequence[tuple[float, float]]]"
#: Names of lines with a meaning -> the token of their colour.
TOKEN_BY_NAME = {"base model": "simulated", "extended model": "extended", "measured": "measured", "truth": "truth"}
#: Maximum number of points drawn for a line.
MAX_POINTS = 300
#: Margins for the axis labels, px.
_MARGIN_LEFT, _MARGIN_BOTTOM = 52, 18


def lines(title: str, curves: Sequence[Line], *, x: str = "", width: int = 380, height: int = 150) -> str:
    """Lines with common axes and a legend."""
    finite_lines = [(name, [p for p in points if all(map(math.isfinite, p))]) for name, points in curves]
    all_points = [p for _, points in finite_lines for p in points]
    if not all_points:
        return ""
    x0, x1 = _range([p[0] for p in all_points])
    y0, y1 = _range([p[1] for p in all_points])
    w, h = width - _MARGIN_LEFT - 8, height - _MARGIN_BOTTOM - 20

    def at(p: tuple[float, float]) -> str:
        return f"{_MARGIN_LEFT + w * (p[0] - x0) / (x1 - x0):.1f},{20 + h * (1 - (p[1] - y0) / (y1 - y0)):.1f}"

    parts = [
        _text(_MARGIN_LEFT, 12, title),
        _text(_MARGIN_LEFT - 4, 26, _tick(y1), "end"),
        _text(_MARGIN_LEFT - 4, 20 + h, _tick(y0), "end"),
    ]
    parts += [_text(_MARGIN_LEFT, height - 4, _tick(x0)), _text(_MARGIN_LEFT + w, height - 4, f"{_tick(x1)} {x}".strip(), "end")]
    parts.append(f'<path d="M{_MARGIN_LEFT} 20V{20 + h}H{_MARGIN_LEFT + w}" fill="none" stroke="var(--line)"/>')
    for i, (name, points) in enumerate(finite_lines):
        step = max(1, math.ceil(len(points) / MAX_POINTS))
        corners = " ".join(map(at, points[::step] + (points[-1:] if (len(points) - 1) % step else [])))
        parts.append(
            f'<polyline points="{corners}" fill="none" stroke="{_colour(name, i)}" stroke-width="1.5">'
            f"<title>{escape(name)}</title></polyline>"
        )
    legend = "".join(
        f'<span style="color:{_colour(name, i)}">{escape(name)}</span> ' for i, (name, _) in enumerate(finite_lines) if name
    )
    return f"<div>{_svg(width, height, parts)}<div>{legend}</div></div>"


def bars(title: str, rows: Sequence[tuple[str, float, bool]], *, width: int = 380) -> str:
    """Horizontal bars: (name, value, whether it is highlighted)."""
    largest = max((abs(value) for _, value, _ in rows), default=0.0) or 1.0
    label_width = min(190, 10 + 6 * max((len(name) for name, _, _ in rows), default=0))
    parts = [_text(0, 12, title)]
    for i, (name, value, highlighted) in enumerate(rows):
        y = 20 + 16 * i
        length = max(1.0, (width - label_width - 64) * abs(value) / largest)
        parts.append(_text(label_width - 6, y + 10, name, "end"))
        parts.append(
            f'<rect x="{label_width}" y="{y + 2}" width="{length:.1f}" height="10" fill="var(--{"extended" if highlighted else "line"})"/>'
        )
        parts.append(_text(round(label_width + length + 4), y + 10, number(value)))
    return _svg(width, 24 + 16 * len(rows), parts)


def intervals(rows: Sequence[tuple[str, float, float, float]], *, width: int = 320) -> str:
    """Values with intervals, each on its own scale: (name, value, low, high)."""
    parts = []
    label_width = min(170, 10 + 7 * max((len(row[0]) for row in rows), default=0))
    for i, (name, value, low, high) in enumerate(rows):
        y = 12 + 26 * i
        edge = 0.6 * max(high - low, 1e-9 * max(abs(value), 1e-9))
        x0, x1 = min(low, value) - edge, max(high, value) + edge
        at = [label_width + (width - label_width - 8) * (v - x0) / (x1 - x0) for v in (low, value, high)]
        parts.append(_text(label_width - 6, y + 4, name, "end"))
        parts.append(f'<path d="M{at[0]:.1f} {y}H{at[2]:.1f}" stroke="var(--extended)" stroke-width="2"/>')
        parts.append(f'<circle cx="{at[1]:.1f}" cy="{y}" r="3.5" fill="var(--extended)"/>')
        parts.append(_text(round(at[0]), y + 14, number(low), "end"))
        parts.append(_text(round(at[2]), y + 14, number(high)))
    return _svg(width, 10 + 26 * len(rows), parts) if rows else ""


def progress_bar(share: float) -> str:
    """A progress bar; 1 is complete."""
    return f'<div class="bar"><i style="width:{100 * min(max(share, 0.0), 1.0):.1f}%"></i></div>'


def _colour(name: str, index: int) -> str:
    return f"var(--{TOKEN_BY_NAME.get(name, f'c{(index + 1) % 6}')})"


def _tick(value: float) -> str:
    """A short label of an axis."""
    return f"{value:.0f}" if 100 <= abs(value) < 1e6 else f"{value:.3g}"


def _range(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}">{escape(text)}</text>'


def _svg(width: int, height: int, parts: Sequence[str]) -> str:
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>'
