"""Writes the twelve throws of this folder and the picture of README (docs/pictures/throw.svg).

    python3 examples/throws/make.py

A ball of 40 mm flies through air. Its acceleration is gravity and a quadratic drag, a = g - k |v| v with k = 0.13 1/m (a
table-tennis ball), integrated by the classical Runge-Kutta method in steps of 1/600 s. It is filmed 60 times a second; each
coordinate has Gaussian noise with a standard deviation of 1 mm. Standard library only.
"""

from __future__ import annotations

import math
import random
from pathlib import Path

HERE = Path(__file__).resolve().parent
PICTURE = HERE.parents[1] / "docs" / "pictures" / "throw.svg"
GRAVITY, DRAG, NOISE, FPS = 9.81, 0.13, 0.001, 60
#: Speed (m/s), angle (degrees), height of release (m).
THROWS = [(speed, angle, 1.2 + 0.1 * (i % 3)) for i, (speed, angle) in enumerate(
    (speed, angle) for speed in (4.0, 6.0, 8.0, 10.0) for angle in (10, 35, 60))]


def acceleration(vx: float, vy: float, drag: float) -> tuple[float, float]:
    speed = math.hypot(vx, vy)
    return -drag * speed * vx, -GRAVITY - drag * speed * vy


def fly(start: list[float], count: int, drag: float) -> list[tuple[float, float]]:
    """Positions (m) at `count` pictures from a start (x, y in m, vx, vy in m/s)."""
    substeps, state, path = 10, list(start), []
    h = 1 / (FPS * substeps)
    for _ in range(count):
        path.append((state[0], state[1]))
        for _ in range(substeps):
            slope, total = [0.0] * 4, [0.0] * 4
            for factor, weight in ((0, 1), (0.5, 2), (0.5, 2), (1, 1)):
                at = [s + factor * h * k for s, k in zip(state, slope)]
                slope = [at[2], at[3], *acceleration(at[2], at[3], drag)]
                total = [t + weight * k / 6 for t, k in zip(total, slope)]
            state = [s + h * t for s, t in zip(state, total)]
    return path


def fit(seen: list[tuple[float, float]], drag: float) -> list[tuple[float, float]]:
    """The path with this drag that is nearest to what was seen: Gauss-Newton steps on the start, numerical derivatives."""
    n = len(seen)
    start = [*seen[0], (seen[3][0] - seen[0][0]) * FPS / 3, (seen[3][1] - seen[0][1]) * FPS / 3]
    for _ in range(8):
        path = fly(start, n, drag)
        left = [s - p for a, b in zip(seen, path) for s, p in zip(a, b)]
        columns = []
        for i in range(4):
            moved = list(start)
            moved[i] += 1e-5
            columns.append([(m - p) / 1e-5 for a, b in zip(fly(moved, n, drag), path) for m, p in zip(a, b)])
        rows = [[sum(a * b for a, b in zip(u, v)) for v in columns] + [sum(a * b for a, b in zip(u, left))] for u in columns]
        for i in range(4):
            rows[i] = [a / rows[i][i] for a in rows[i]]
            for j in range(4):
                if j != i:
                    rows[j] = [a - rows[j][i] * b for a, b in zip(rows[j], rows[i])]
        start = [s + row[4] for s, row in zip(start, rows)]
    return fly(start, n, drag)


def picture(throws: list[list[tuple[float, float]]]) -> str:
    """One throw: as measured, as simulated without drag and with it."""
    seen = throws[10]
    without, extended = fit(seen, 0.0), fit(seen, DRAG)
    everything = [p for path in (*throws, without) for p in path]
    left, right = min(x for x, _ in everything), max(x for x, _ in everything)
    low, high = min(y for _, y in everything), max(y for _, y in everything)
    scale = 700 / (right - left)
    height = round((high - low) * scale) + 70

    def points(path: list[tuple[float, float]]) -> str:
        return " ".join(f"{20 + (x - left) * scale:.1f},{20 + (high - y) * scale:.1f}" for x, y in path)

    def dots(path: list[tuple[float, float]]) -> str:
        return "".join(
            f'<circle cx="{20 + (x - left) * scale:.1f}" cy="{20 + (high - y) * scale:.1f}" r="3"/>' for x, y in path[::2])

    lines = "".join(f'<polyline points="{points(path)}"/>' for path in throws)
    legend = [("#111", "measured", 20), ("#d9480f", "best simulation without air drag", 130), ("#1864ab", "simulation with the drag found", 400)]
    words = "".join(
        f'<circle cx="{x}" cy="{height - 18}" r="5" fill="{colour}"/><text x="{x + 12}" y="{height - 13}">{text}</text>'
        for colour, text, x in legend)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 740 {height}" width="740" height="{height}" '
        'font-family="sans-serif" font-size="15" role="img" aria-label="A throw as measured, and simulated without and with drag">'
        '<rect width="100%" height="100%" fill="#fff"/>'
        f'<g fill="none" stroke="#ced4da" stroke-width="1">{lines}</g>'
        f'<polyline points="{points(without)}" fill="none" stroke="#d9480f" stroke-width="2.5" stroke-dasharray="7 5"/>'
        f'<polyline points="{points(extended)}" fill="none" stroke="#1864ab" stroke-width="2.5"/>'
        f'<g fill="#111">{dots(seen)}</g><g fill="#111">{words}</g></svg>\n'
    )


def main() -> None:
    noise = random.Random(1)
    throws = []
    for number, (speed, angle, height) in enumerate(THROWS, 1):
        a = math.radians(angle)
        path = fly([0.0, height, speed * math.cos(a), speed * math.sin(a)], 42, DRAG)
        seen = [(x + noise.gauss(0, NOISE), y + noise.gauss(0, NOISE)) for x, y in path]
        rows = [f"{i / FPS:.4f},{x:.4f},{y:.4f}" for i, (x, y) in enumerate(seen)]
        (HERE / f"throw{number:02}.csv").write_text("\n".join(["t,x,y", *rows]) + "\n", encoding="utf-8")
        throws.append(seen)
    PICTURE.write_text(picture(throws), encoding="utf-8")


if __name__ == "__main__":
    main()
