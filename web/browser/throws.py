"""Simulated tracks of thrown balls with quadratic drag, in the format of tracking software."""

import random
from collections.abc import Callable

GRAVITY, RADIUS, STEPS = 9.81, 0.02, 20

#: Time (s), x and y (m) of each frame.
Track = list[tuple[float, float, float]]
#: Ranges of the velocities along x and y, m/s: distinguishing drag laws, staying near a floor, and hardly informative.
Speeds = tuple[tuple[float, float], tuple[float, float]]
FAST: Speeds = ((2.5, 9), (-1, 5))
LOW: Speeds = ((2, 4), (-1, 2))
SIMILAR: Speeds = ((3.9, 4.1), (1.5, 1.8))


def quadratic(k: float) -> Callable[[float, float], tuple[float, float]]:
    """Acceleration of a ball with quadratic drag, k in 1/m."""

    def acceleration(vx: float, vy: float) -> tuple[float, float]:
        speed = float((vx * vx + vy * vy) ** 0.5)
        return -k * vx * speed, -GRAVITY - k * vy * speed

    return acceleration


def launch(k: float, height: float, velocity: tuple[float, float], samples: int, fps: float, bounce: float | None) -> Track:
    """A track integrated with the midpoint rule; at a floor at 0 the ball bounces with restitution `bounce`."""
    acceleration, dt, rows = quadratic(k), 1 / fps / STEPS, []
    (x, y), (vx, vy) = (0.0, height), velocity
    for frame in range(samples):
        rows.append((frame / fps, x, y))
        for _ in range(STEPS):
            ax, ay = acceleration(vx, vy)
            mx, my = vx + 0.5 * dt * ax, vy + 0.5 * dt * ay
            ax, ay = acceleration(mx, my)
            x, y, vx, vy = x + dt * mx, y + dt * my, vx + dt * ax, vy + dt * ay
            if bounce is not None and y < RADIUS and vy < 0:
                y, vx, vy = 2 * RADIUS - y, 0.9 * vx, -bounce * vy
    return rows


def launches(count: int, samples: int, k: float = 0.2, bounce: float | None = None, noise: float = 0.001, speeds: Speeds = FAST) -> list[Track]:
    """Launches at 100 frames per second with random speeds and angles and with noise (m); deterministic."""
    rng, tracks = random.Random(1), []
    for _ in range(count):
        velocity = (rng.uniform(*speeds[0]), rng.uniform(*speeds[1]))
        rows = launch(k, rng.uniform(0.3, 0.5), velocity, samples, 100, bounce)
        tracks.append([(t, x + rng.gauss(0, noise), y + rng.gauss(0, noise)) for t, x, y in rows])
    return tracks


def csv(tracks: list[Track], header: str = "trial,t,x,y", scale: float = 1.0, down: bool = False) -> str:
    """All launches as one table; lengths in units of `scale` m."""
    up = -1 if down else 1
    rows = [f"{i},{t:.4f},{x / scale:.5f},{up * y / scale:.5f}" for i, track in enumerate(tracks) for t, x, y in track]
    return "\n".join([header, *rows]) + "\n"
