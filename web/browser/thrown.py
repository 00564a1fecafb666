"""Tracks of thrown balls as programs for tracking write them, with a drag that a simulation of a ball alone lacks."""

import random
from collections.abc import Callable

GRAVITY, RADIUS, STEPS = 9.81, 0.02, 20

#: Time (s), x and y (m) of each picture.
Track = list[tuple[float, float, float]]
#: Ranges of the velocities along x and y, m/s: that tell drags apart, that stay over a floor, and that tell hardly anything.
Speeds = tuple[tuple[float, float], tuple[float, float]]
FAST: Speeds = ((2.5, 9), (-1, 5))
LOW: Speeds = ((2, 4), (-1, 2))
ALIKE: Speeds = ((3.9, 4.1), (1.5, 1.8))


def quadratic(k: float) -> Callable[[float, float], tuple[float, float]]:
    """Acceleration of a ball with quadratic drag, k in 1/m."""

    def law(vx: float, vy: float) -> tuple[float, float]:
        speed = float((vx * vx + vy * vy) ** 0.5)
        return -k * vx * speed, -GRAVITY - k * vy * speed

    return law


def launch(k: float, height: float, velocity: tuple[float, float], samples: int, fps: float, bounce: float | None) -> Track:
    """A ball by small steps (midpoint rule); off a floor at 0 it comes back with `bounce` of its speed."""
    law, dt, rows = quadratic(k), 1 / fps / STEPS, []
    (x, y), (vx, vy) = (0.0, height), velocity
    for picture in range(samples):
        rows.append((picture / fps, x, y))
        for _ in range(STEPS):
            ax, ay = law(vx, vy)
            mx, my = vx + 0.5 * dt * ax, vy + 0.5 * dt * ay
            ax, ay = law(mx, my)
            x, y, vx, vy = x + dt * mx, y + dt * my, vx + dt * ax, vy + dt * ay
            if bounce is not None and y < RADIUS and vy < 0:
                y, vx, vy = 2 * RADIUS - y, 0.9 * vx, -bounce * vy
    return rows


def launches(count: int, samples: int, k: float = 0.2, bounce: float | None = None, noise: float = 0.001, speeds: Speeds = FAST) -> list[Track]:
    """Launches at 100 pictures a second that differ in speed and angle, with noise (m); always the same ones."""
    draw, found = random.Random(1), []
    for _ in range(count):
        velocity = (draw.uniform(*speeds[0]), draw.uniform(*speeds[1]))
        rows = launch(k, draw.uniform(0.3, 0.5), velocity, samples, 100, bounce)
        found.append([(t, x + draw.gauss(0, noise), y + draw.gauss(0, noise)) for t, x, y in rows])
    return found


def csv(found: list[Track], header: str = "trial,t,x,y", scale: float = 1.0, down: bool = False) -> str:
    """All launches in one table; lengths in units of `scale` m."""
    up = -1 if down else 1
    rows = [f"{i},{t:.4f},{x / scale:.5f},{up * y / scale:.5f}" for i, track in enumerate(found) for t, x, y in track]
    return "\n".join([header, *rows]) + "\n"
