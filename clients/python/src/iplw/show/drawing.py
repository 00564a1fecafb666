"""Scenes, and the ways of bodies through them, as SVG: metres, y up."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: name -> (n, 3) x and y, m, and angle, rad.
Tracks: TypeAlias = "Mapping[str, NDArray[np.float64]]"
#: left, bottom, right, top, m.
Box: TypeAlias = "tuple[float, float, float, float]"

#: Bodies whose name is a colour have it; others take turns.
_NAMED = {"green": 0, "blue": 1, "red": 2}
#: Points of a way that are drawn; more cannot be told apart.
MOST_POINTS = 400
#: A velocity is drawn as the way in this time, s.
ARROW_S = 0.1


def drawing(scene: Mapping[str, Any] | None, tracks: Sequence[Tracks] = (), *, width: int = 320) -> str:
    """The scene with everything where it starts, the ways of its bodies, and where they end.

    Of several tracks all ways are drawn, and where bodies end only for the first. Without a scene the ways stand alone.
    """
    bodies = list((scene or {}).get("bodies", []))
    names = [body["name"] for body in bodies] + [name for track in tracks for name in track]
    colours = {name: f"var(--c{_NAMED.get(name, i % 6)})" for i, name in enumerate(dict.fromkeys(names))}
    box = extent(scene, tracks)
    left, bottom, right, top = box
    thin = (right - left) / width
    parts = [_static(static, box) for static in (scene or {}).get("statics", [])]
    parts += [_goal(scene, box)]
    for body in bodies:
        if "position" in body and not (tracks and body["name"] in tracks[0]):
            parts.append(
                _body(body["shape"], body["position"], body.get("angle", 0.0), colours[body["name"]], body["name"])
            )
            parts.append(_arrow(body, colours[body["name"]], thin))
    shapes = {body["name"]: body["shape"] for body in bodies}
    for track in tracks:
        parts += [_way(states, colours[name], name, 1.5 if len(tracks) == 1 else 0.8) for name, states in track.items()]
    for name, states in (tracks[0] if tracks else {}).items():
        seen = states[np.isfinite(states[:, :2]).all(axis=1)]
        if len(seen):
            dot = {"type": "disc", "radius": 3 * thin}
            first, last = seen[0], seen[-1]
            parts.append(_body(shapes.get(name, dot), first[:2], first[2], colours[name], name, faint=True))
            parts.append(_body(shapes.get(name, dot), last[:2], last[2], colours[name], name))
    height = max(40, round(width * (top - bottom) / (right - left)))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" role="img" '
        f'viewBox="{left:.6g} {-top:.6g} {right - left:.6g} {top - bottom:.6g}" '
        'style="background:var(--paper);border:1px solid var(--line)">'
        f'<g transform="scale(1,-1)">{"".join(parts)}</g></svg>'
    )


def extent(scene: Mapping[str, Any] | None, tracks: Sequence[Tracks] = ()) -> Box:
    """What is to be seen: the bounds of actions where there are any, else all that moves and the statics near it."""
    bounds = ((scene or {}).get("action") or {}).get("bounds")
    if bounds is not None:
        left, bottom, right, top = map(float, bounds)
        edge = 0.02 * max(right - left, top - bottom)
        return left - edge, bottom - edge, right + edge, top + edge
    points = [states[:, :2] for track in tracks for states in track.values()]
    for body in (scene or {}).get("bodies", []):
        if "position" in body:
            reach, at = _reach(body["shape"]), np.array(body["position"], dtype=float)
            points.append(at + reach * np.array([[-1.0, -1.0], [1.0, 1.0]]))
            points.append((at + ARROW_S * np.array(body.get("velocity", (0.0, 0.0))))[None])
    if not points:
        points = [
            _corners(static) for static in (scene or {}).get("statics", []) if static["shape"]["type"] != "halfspace"
        ]
    seen = np.concatenate([np.zeros((0, 2)), *points])
    seen = seen[np.isfinite(seen).all(axis=1)]
    low, high = (seen.min(axis=0), seen.max(axis=0)) if len(seen) else (np.zeros(2), np.ones(2))
    size = float(max(high - low)) or 1.0
    # A flat way gets room above and below: at least a quarter of its length.
    room = np.maximum(0.25 * size - (high - low), 0.0) / 2 + 0.06 * size
    low, high = low - room, high + room
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _goal(scene: Mapping[str, Any] | None, box: Box) -> str:
    """The region that a goal names, or all above its line, as far as it is seen."""
    goal = (scene or {}).get("goal") or {}
    region = _above(goal, box) if goal.get("type") == "above" else goal.get("region")
    if not region:
        return ""
    return f'<polygon points="{_points(region)}" fill="var(--c3)" fill-opacity=".25"><title>goal</title></polygon>'


def _above(goal: Mapping[str, Any], box: Box) -> list[tuple[float, float]]:
    """A piece of what lies above the goal's line that covers the box."""
    (ax, ay), (bx, by) = goal.get("line") or ((0.0, goal["height"]), (1.0, goal["height"]))
    sign = -1.0 if bx < ax else 1.0
    normal = (sign * (by - ay), -sign * (bx - ax))
    return _below({"normal": normal, "offset": normal[0] * ax + normal[1] * ay}, box)


def _static(static: Mapping[str, Any], box: Box) -> str:
    x, y = static.get("position", (0.0, 0.0))
    inside = _outline(static["shape"], box)
    turn = math.degrees(static.get("angle", 0.0))
    style = 'fill="var(--fill)" stroke="var(--soft)" stroke-width="1" vector-effect="non-scaling-stroke"'
    where = f"translate({x:.6g},{y:.6g}) rotate({turn:.6g})"
    return f'<g transform="{where}" {style}><title>{escape(str(static.get("name", "")))}</title>{inside}</g>'


def _body(
    shape: Mapping[str, Any],
    position: Sequence[float] | NDArray[Any],
    angle: float,
    colour: str,
    name: str,
    faint: bool = False,
) -> str:
    x, y = float(position[0]), float(position[1])
    turn = math.degrees(float(angle)) if math.isfinite(angle) else 0.0
    fill = f'fill="{colour}" fill-opacity="{0 if faint else 0.55}" stroke="{colour}" stroke-width="1"'
    dash = ' stroke-dasharray="3 2" stroke-opacity=".7"' if faint else ""
    spoke = ""
    if shape["type"] == "disc" and not faint:
        spoke = f'<path d="M0 0H{shape["radius"]:.5g}" vector-effect="non-scaling-stroke"/>'
    return (
        f'<g transform="translate({x:.5g},{y:.5g}) rotate({turn:.5g})" {fill}{dash}><title>{escape(name)}</title>'
        f"{_outline(shape)}{spoke}</g>"
    )


def _arrow(body: Mapping[str, Any], colour: str, thin: float) -> str:
    """The way that a moving body is about to go."""
    vx, vy = body.get("velocity", (0.0, 0.0))
    speed = math.hypot(vx, vy)
    if ARROW_S * speed < 4 * thin:
        return ""
    (x, y), ux, uy, tip = body["position"], vx / speed, vy / speed, 6 * thin
    ex, ey = x + ARROW_S * vx, y + ARROW_S * vy
    sides = [(ex - tip * (ux + s * 0.5 * uy), ey - tip * (uy - s * 0.5 * ux)) for s in (1, -1)]
    corners = [(x, y), (ex, ey), sides[0], (ex, ey), sides[1]]
    path = "".join(f"{pen}{px:.5g} {py:.5g}" for pen, (px, py) in zip("MLMLL", corners))
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.2" vector-effect="non-scaling-stroke"/>'


def _way(states: NDArray[np.float64], colour: str, name: str, weight: float) -> str:
    """A way, broken where it was not seen."""
    step = max(1, math.ceil(len(states) / MOST_POINTS))
    rows = states[::step, :2]
    if len(states) and (len(states) - 1) % step:
        rows = np.vstack([rows, states[-1:, :2]])
    path, pen = [], "M"
    for x, y in rows.tolist():
        if math.isfinite(x) and math.isfinite(y):
            path.append(f"{pen}{x:.5g} {y:.5g}")
            pen = "L"
        else:
            pen = "M"
    return (
        f'<path d="{"".join(path)}" fill="none" stroke="{colour}" stroke-width="{weight}" stroke-linejoin="round" '
        f'vector-effect="non-scaling-stroke"><title>{escape(name)}</title></path>'
    )


def _outline(shape: Mapping[str, Any], box: Box = (-1e3, -1e3, 1e3, 1e3)) -> str:
    """A shape in its own frame."""
    thin = 'vector-effect="non-scaling-stroke"'
    match shape["type"]:
        case "disc":
            return f'<circle r="{shape["radius"]:.5g}" {thin}/>'
        case "box":
            w, h = shape["half_width"], shape["half_height"]
            return f'<rect x="{-w:.5g}" y="{-h:.5g}" width="{2 * w:.5g}" height="{2 * h:.5g}" {thin}/>'
        case "polygon":
            return f'<polygon points="{_points(shape["vertices"])}" {thin}/>'
        case "segment":
            (x1, y1), (x2, y2) = shape["from"], shape["to"]
            wide = (
                f' style="stroke-width:{2 * r:.5g};stroke-linecap:round"' if (r := shape.get("radius", 0.0)) else thin
            )
            return f'<line x1="{x1:.5g}" y1="{y1:.5g}" x2="{x2:.5g}" y2="{y2:.5g}" {wide}/>'
        case "compound":
            return "".join(_piece(piece) for piece in shape["pieces"])
        case "halfspace":
            return f'<polygon points="{_points(_below(shape, box))}" {thin}/>'
        case _:
            return ""


def _piece(piece: Mapping[str, Any]) -> str:
    x, y = piece.get("position", (0.0, 0.0))
    shape = piece.get("shape", piece)
    turn = math.degrees(piece.get("angle", 0.0))
    return f'<g transform="translate({x:.5g},{y:.5g}) rotate({turn:.5g})">{_outline(shape)}</g>'


def _below(shape: Mapping[str, Any], box: Box) -> list[tuple[float, float]]:
    """A piece of a half-space that covers the box: everything with normal . p < offset."""
    nx, ny = shape["normal"]
    length = math.hypot(nx, ny) or 1.0
    nx, ny, offset = nx / length, ny / length, shape.get("offset", 0.0) / length
    size = 4 * max(box[2] - box[0], box[3] - box[1]) + abs(box[0]) + abs(box[1])
    px, py = nx * offset, ny * offset
    far = [(px - ny * s * size, py + nx * s * size) for s in (-1, 1)]
    return [*far, *[(x - nx * size, y - ny * size) for x, y in reversed(far)]]


def _points(points: Sequence[Sequence[float]]) -> str:
    return " ".join(f"{x:.5g},{y:.5g}" for x, y in points)


def _reach(shape: Mapping[str, Any]) -> float:
    """The distance that a shape keeps within, from its origin, m."""
    match shape["type"]:
        case "disc":
            return float(shape["radius"])
        case "compound":
            return max(_reach(p.get("shape", p)) + math.hypot(*p.get("position", (0, 0))) for p in shape["pieces"])
        case _:
            return float(np.linalg.norm(_ends(shape), axis=1).max(initial=0.0)) + float(shape.get("radius", 0.0))


def _ends(shape: Mapping[str, Any]) -> NDArray[np.float64]:
    """(n, 2) points that a shape lies between, in its frame."""
    match shape["type"]:
        case "box":
            w, h = shape["half_width"], shape["half_height"]
            return np.array([[-w, -h], [w, -h], [w, h], [-w, h]], dtype=float)
        case "polygon":
            return np.array(shape["vertices"], dtype=float)
        case "segment":
            return np.array([shape["from"], shape["to"]], dtype=float)
        case _:
            return np.array([[-_reach(shape)] * 2, [_reach(shape)] * 2])


def _corners(static: Mapping[str, Any]) -> NDArray[np.float64]:
    cos, sin = math.cos(static.get("angle", 0.0)), math.sin(static.get("angle", 0.0))
    turned = _ends(static["shape"]) @ np.array([[cos, sin], [-sin, cos]])
    return np.asarray(turned + np.array(static.get("position", (0.0, 0.0)), dtype=float))
