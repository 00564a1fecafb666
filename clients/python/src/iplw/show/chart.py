"""Small charts as SVG: lines, intervals, bars. What is to be measured on is drawn by `iplw.plot`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import TypeAlias

from .page import number

#: A line: its name, and (x, y) of its points; those that are not finite are left out.
Line: TypeAlias = "tuple[str, Sequence[tuple[float, float]]]"
#: Points of a line that are drawn.
MOST_POINTS = 300
#: Room left of a chart for the numbers at its axis, and below, pixels.
_LEFT, _BELOW = 52, 18


def lines(title: str, drawn: Sequence[Line], *, x: str = "", width: int = 380, height: int = 150) -> str:
    """Lines over a common range, named beneath."""
    kept = [(name, [p for p in points if all(map(math.isfinite, p))]) for name, points in drawn]
    every = [p for _, points in kept for p in points]
    if not every:
        return ""
    x0, x1 = _range([p[0] for p in every])
    y0, y1 = _range([p[1] for p in every])
    w, h = width - _LEFT - 8, height - _BELOW - 20

    def at(p: tuple[float, float]) -> str:
        return f"{_LEFT + w * (p[0] - x0) / (x1 - x0):.1f},{20 + h * (1 - (p[1] - y0) / (y1 - y0)):.1f}"

    parts = [
        _text(_LEFT, 12, title),
        _text(_LEFT - 4, 26, _tick(y1), "end"),
        _text(_LEFT - 4, 20 + h, _tick(y0), "end"),
    ]
    parts += [_text(_LEFT, height - 4, _tick(x0)), _text(_LEFT + w, height - 4, f"{_tick(x1)} {x}".strip(), "end")]
    parts.append(f'<path d="M{_LEFT} 20V{20 + h}H{_LEFT + w}" fill="none" stroke="var(--line)"/>')
    for i, (name, points) in enumerate(kept):
        step = max(1, math.ceil(len(points) / MOST_POINTS))
        corners = " ".join(map(at, points[::step] + (points[-1:] if (len(points) - 1) % step else [])))
        parts.append(
            f'<polyline points="{corners}" fill="none" stroke="var(--c{(i + 1) % 6})" stroke-width="1.5">'
            f"<title>{escape(name)}</title></polyline>"
        )
    named = "".join(
        f'<span style="color:var(--c{(i + 1) % 6})">{escape(name)}</span> ' for i, (name, _) in enumerate(kept) if name
    )
    return f"<div>{_svg(width, height, parts)}<div>{named}</div></div>"


def bars(title: str, rows: Sequence[tuple[str, float, bool]], *, width: int = 380) -> str:
    """A bar a row, (name, value, whether it stands out), from nothing to its value."""
    most = max((abs(value) for _, value, _ in rows), default=0.0) or 1.0
    room = min(190, 10 + 6 * max((len(name) for name, _, _ in rows), default=0))
    parts = [_text(0, 12, title)]
    for i, (name, value, strong) in enumerate(rows):
        y = 20 + 16 * i
        long = max(1.0, (width - room - 64) * abs(value) / most)
        parts.append(_text(room - 6, y + 10, name, "end"))
        parts.append(
            f'<rect x="{room}" y="{y + 2}" width="{long:.1f}" height="10" fill="var(--{"c1" if strong else "line"})"/>'
        )
        parts.append(_text(round(room + long + 4), y + 10, number(value)))
    return _svg(width, 24 + 16 * len(rows), parts)


def intervals(rows: Sequence[tuple[str, float, float, float]], *, width: int = 320) -> str:
    """A value with its interval a row, each on a scale of its own: (name, value, low, high)."""
    parts = []
    room = min(170, 10 + 7 * max((len(row[0]) for row in rows), default=0))
    for i, (name, value, low, high) in enumerate(rows):
        y = 12 + 26 * i
        edge = 0.6 * max(high - low, 1e-9 * max(abs(value), 1e-9))
        x0, x1 = min(low, value) - edge, max(high, value) + edge
        at = [room + (width - room - 8) * (v - x0) / (x1 - x0) for v in (low, value, high)]
        parts.append(_text(room - 6, y + 4, name, "end"))
        parts.append(f'<path d="M{at[0]:.1f} {y}H{at[2]:.1f}" stroke="var(--c1)" stroke-width="2"/>')
        parts.append(f'<circle cx="{at[1]:.1f}" cy="{y}" r="3.5" fill="var(--c1)"/>')
        parts.append(_text(round(at[0]), y + 14, number(low), "end"))
        parts.append(_text(round(at[2]), y + 14, number(high)))
    return _svg(width, 10 + 26 * len(rows), parts) if rows else ""


def progress(share: float) -> str:
    """A bar, full at 1."""
    return f'<div class="bar"><i style="width:{100 * min(max(share, 0.0), 1.0):.1f}%"></i></div>'


def _tick(value: float) -> str:
    """A number that fits left of an axis."""
    return f"{value:.0f}" if 100 <= abs(value) < 1e6 else f"{value:.3g}"


def _range(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}">{escape(text)}</text>'


def _svg(width: int, height: int, parts: Sequence[str]) -> str:
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>'
