"""Scenes and trajectories as SVG, in metres, y up."""

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

#: Colour index of bodies that are named after a colour; others cycle.
_COLOUR_BY_NAME = {"green": 0, "blue": 1, "red": 2}
#: Maximum number of points drawn for a trajectory.
MAX_POINTS = 400
#: The arrow of a velocity is the displacement in this time, s.
ARROW_S = 0.1


def drawing(scene: Mapping[str, Any] | None, tracks: Sequence[Tracks] = (), *, width: int = 320) -> str:
    """The scene at the start, trajectories of its bodies, and their final positions.

    With several tracks, final positions are drawn for the first only. Without a scene only the trajectories are drawn.
    """
    bodies = list((scene or {}).get("bodies", []))
    names = [body["name"] for body in bodies] + [name for track in tracks for name in track]
    colours = {name: f"var(--c{_COLOUR_BY_NAME.get(name, i % 6)})" for i, name in enumerate(dict.fromkeys(names))}
    box = extent(scene, tracks)
    left, bottom, right, top = box
    pixel = (right - left) / width
    parts = [_static(static, box) for static in (scene or {}).get("statics", [])]
    parts += [_goal(scene, box)]
    for body in bodies:
        if "position" in body and not (tracks and body["name"] in tracks[0]):
            parts.append(
                _body(body["shape"], body["position"], body.get("angle", 0.0), colours[body["name"]], body["name"])
            )
            parts.append(_arrow(body, colours[body["name"]], pixel))
    shapes = {body["name"]: body["shape"] for body in bodies}
    for track in tracks:
        parts += [_path(states, colours[name], name, 1.5 if len(tracks) == 1 else 0.8) for name, states in track.items()]
    for name, states in (tracks[0] if tracks else {}).items():
        observed = states[np.isfinite(states[:, :2]).all(axis=1)]
        if len(observed):
            dot = {"type": "disc", "radius": 3 * pixel}
            first, last = observed[0], observed[-1]
            parts.append(_body(shapes.get(name, dot), first[:2], first[2], colours[name], name, faint=True))
            parts.append(_body(shapes.get(name, dot), last[:2], last[2], colours[name], name))
    height = max(40, round(width * (top - bottom) / (right - left)))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" role="img" '
        f'viewBox="{left:.6g} {-top:.6g} {right - left:.6g} {top - bottom:.6g}" '
        'style="background:var(--scene);border:1px solid var(--line)">'
        f'<g transform="scale(1,-1)">{"".join(parts)}</g></svg>'
    )


def extent(scene: Mapping[str, Any] | None, tracks: Sequence[Tracks] = ()) -> Box:
    """The visible region: the bounds of actions, else the bounding box of moving bodies."""
    bounds = ((scene or {}).get("action") or {}).get("bounds")
    if bounds is not None:
        left, bottom, right, top = map(float, bounds)
        edge = 0.02 * max(right - left, top - bottom)
        return left - edge, bottom - edge, right + edge, top + edge
    points = [states[:, :2] for track in tracks for states in track.values()]
    for body in (scene or {}).get("bodies", []):
        if "position" in body:
            radius, at = _bounding_radius(body["shape"]), np.array(body["position"], dtype=float)
            points.append(at + radius * np.array([[-1.0, -1.0], [1.0, 1.0]]))
            points.append((at + ARROW_S * np.array(body.get("velocity", (0.0, 0.0))))[None])
    if not points:
        points = [
            _corners(static) for static in (scene or {}).get("statics", []) if static["shape"]["type"] != "halfspace"
        ]
    observed = np.concatenate([np.zeros((0, 2)), *points])
    observed = observed[np.isfinite(observed).all(axis=1)]
    low, high = (observed.min(axis=0), observed.max(axis=0)) if len(observed) else (np.zeros(2), np.ones(2))
    size = float(max(high - low)) or 1.0
    # Minimum aspect: a margin of a quarter of the length across a flat trajectory.
    margin = np.maximum(0.25 * size - (high - low), 0.0) / 2 + 0.06 * size
    low, high = low - margin, high + margin
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _goal(scene: Mapping[str, Any] | None, box: Box) -> str:
    """The region of a goal, or the visible half-plane above its line."""
    goal = (scene or {}).get("goal") or {}
    region = _region_above(goal, box) if goal.get("type") == "above" else goal.get("region")
    if not region:
        return ""
    return f'<polygon points="{_points(region)}" fill="var(--goal)" fill-opacity=".25"><title>goal</title></polygon>'


def _region_above(goal: Mapping[str, Any], box: Box) -> list[tuple[float, float]]:
    """A polygon of the region above the goal's line that covers the box."""
    (ax, ay), (bx, by) = goal.get("line") or ((0.0, goal["height"]), (1.0, goal["height"]))
    sign = -1.0 if bx < ax else 1.0
    normal = (sign * (by - ay), -sign * (bx - ax))
    return _halfspace_polygon({"normal": normal, "offset": normal[0] * ax + normal[1] * ay}, box)


def _static(static: Mapping[str, Any], box: Box) -> str:
    x, y = static.get("position", (0.0, 0.0))
    outline = _outline(static["shape"], box)
    angle_deg = math.degrees(static.get("angle", 0.0))
    style = 'fill="var(--fill)" stroke="var(--soft)" stroke-width="1" vector-effect="non-scaling-stroke"'
    transform = f"translate({x:.6g},{y:.6g}) rotate({angle_deg:.6g})"
    return f'<g transform="{transform}" {style}><title>{escape(str(static.get("name", "")))}</title>{outline}</g>'


def _body(
    shape: Mapping[str, Any],
    position: Sequence[float] | NDArray[Any],
    angle: float,
    colour: str,
    name: str,
    faint: bool = False,
) -> str:
    x, y = float(position[0]), float(position[1])
    angle_deg = math.degrees(float(angle)) if math.isfinite(angle) else 0.0
    fill = f'fill="{colour}" fill-opacity="{0 if faint else 0.55}" stroke="{colour}" stroke-width="1"'
    dash = ' stroke-dasharray="3 2" stroke-opacity=".7"' if faint else ""
    spoke = ""
    if shape["type"] == "disc" and not faint:
        spoke = f'<path d="M0 0H{shape["radius"]:.5g}" vector-effect="non-scaling-stroke"/>'
    return (
        f'<g transform="translate({x:.5g},{y:.5g}) rotate({angle_deg:.5g})" {fill}{dash}><title>{escape(name)}</title>'
        f"{_outline(shape)}{spoke}</g>"
    )


def _arrow(body: Mapping[str, Any], colour: str, pixel: float) -> str:
    """The arrow of a body's velocity."""
    vx, vy = body.get("velocity", (0.0, 0.0))
    speed = math.hypot(vx, vy)
    if ARROW_S * speed < 4 * pixel:
        return ""
    (x, y), ux, uy, tip = body["position"], vx / speed, vy / speed, 6 * pixel
    ex, ey = x + ARROW_S * vx, y + ARROW_S * vy
    sides = [(ex - tip * (ux + s * 0.5 * uy), ey - tip * (uy - s * 0.5 * ux)) for s in (1, -1)]
    corners = [(x, y), (ex, ey), sides[0], (ex, ey), sides[1]]
    path = "".join(f"{pen}{px:.5g} {py:.5g}" for pen, (px, py) in zip("MLMLL", corners))
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.2" vector-effect="non-scaling-stroke"/>'


def _path(states: NDArray[np.float64], colour: str, name: str, weight: float) -> str:
    """A trajectory, interrupted at missing observations."""
    step = max(1, math.ceil(len(states) / MAX_POINTS))
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
    """SVG of a shape in its own frame."""
    pixel = 'vector-effect="non-scaling-stroke"'
    match shape["type"]:
        case "disc":
            return f'<circle r="{shape["radius"]:.5g}" {pixel}/>'
        case "box":
            w, h = shape["half_width"], shape["half_height"]
            return f'<rect x="{-w:.5g}" y="{-h:.5g}" width="{2 * w:.5g}" height="{2 * h:.5g}" {pixel}/>'
        case "polygon":
            return f'<polygon points="{_points(shape["vertices"])}" {pixel}/>'
        case "segment":
            (x1, y1), (x2, y2) = shape["from"], shape["to"]
            stroke = (
                f' style="stroke-width:{2 * r:.5g};stroke-linecap:round"' if (r := shape.get("radius", 0.0)) else pixel
            )
            return f'<line x1="{x1:.5g}" y1="{y1:.5g}" x2="{x2:.5g}" y2="{y2:.5g}" {stroke}/>'
        case "compound":
            return "".join(_piece(piece) for piece in shape["pieces"])
        case "halfspace":
            return f'<polygon points="{_points(_halfspace_polygon(shape, box))}" {pixel}/>'
        case _:
            return ""


def _piece(piece: Mapping[str, Any]) -> str:
    x, y = piece.get("position", (0.0, 0.0))
    shape = piece.get("shape", piece)
    angle_deg = math.degrees(piece.get("angle", 0.0))
    return f'<g transform="translate({x:.5g},{y:.5g}) rotate({angle_deg:.5g})">{_outline(shape)}</g>'


def _halfspace_polygon(shape: Mapping[str, Any], box: Box) -> list[tuple[float, float]]:
    """A polygon of the half-space normal . p < offset that covers the box."""
    nx, ny = shape["normal"]
    length = math.hypot(nx, ny) or 1.0
    nx, ny, offset = nx / length, ny / length, shape.get("offset", 0.0) / length
    size = 4 * max(box[2] - box[0], box[3] - box[1]) + abs(box[0]) + abs(box[1])
    px, py = nx * offset, ny * offset
    edge = [(px - ny * s * size, py + nx * s * size) for s in (-1, 1)]
    return [*edge, *[(x - nx * size, y - ny * size) for x, y in reversed(edge)]]


def _points(points: Sequence[Sequence[float]]) -> str:
    return " ".join(f"{x:.5g},{y:.5g}" for x, y in points)


def _bounding_radius(shape: Mapping[str, Any]) -> float:
    """Radius of the bounding circle about the origin of a shape, m."""
    match shape["type"]:
        case "disc":
            return float(shape["radius"])
        case "compound":
            return max(_bounding_radius(p.get("shape", p)) + math.hypot(*p.get("position", (0, 0))) for p in shape["pieces"])
        case _:
            return float(np.linalg.norm(_vertices(shape), axis=1).max(initial=0.0)) + float(shape.get("radius", 0.0))


def _vertices(shape: Mapping[str, Any]) -> NDArray[np.float64]:
    """(n, 2) vertices of a shape in its own frame."""
    match shape["type"]:
        case "box":
            w, h = shape["half_width"], shape["half_height"]
            return np.array([[-w, -h], [w, -h], [w, h], [-w, h]], dtype=float)
        case "polygon":
            return np.array(shape["vertices"], dtype=float)
        case "segment":
            return np.array([shape["from"], shape["to"]], dtype=float)
        case _:
            return np.array([[-_bounding_radius(shape)] * 2, [_bounding_radius(shape)] * 2])


def _corners(static: Mapping[str, Any]) -> NDArray[np.float64]:
    cos, sin = math.cos(static.get("angle", 0.0)), math.sin(static.get("angle", 0.0))
    rotated = _vertices(static["shape"]) @ np.array([[cos, sin], [-sin, cos]])
    return np.asarray(rotated + np.array(static.get("position", (0.0, 0.0)), dtype=float))
