"""Writes the recordings of the gallery (docs/gallery/index.md), each in a folder of its own.

    python3 examples/recordings/make.py

The motion is integrated by the classical Runge-Kutta method in steps of at most 1/2400 s; bounces are located to a microsecond.
Every recording has the dirt of films: Gaussian noise, one point in a hundred a centimetre or more off, effect sizes that differ by
3 % between launches, a camera turned by 0.1 degrees. Standard library only.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
GRAVITY = 9.81
STEP = 1 / 2400
TURN = math.radians(0.1)
#: Acceleration (m/s^2) beside gravity at a place (m) with a velocity (m/s).
Force = Callable[[float, float, float, float], tuple[float, float]]
#: t (s), x and y (m).
Track = list[tuple[float, float, float]]


def step(state: list[float], force: Force, h: float, fall: float) -> list[float]:
    slope, total = [0.0] * 4, [0.0] * 4
    for factor, weight in ((0, 1), (0.5, 2), (0.5, 2), (1, 1)):
        x, y, vx, vy = (s + factor * h * k for s, k in zip(state, slope))
        ax, ay = force(x, y, vx, vy)
        slope = [vx, vy, ax, ay - fall]
        total = [t + weight * k / 6 for t, k in zip(total, slope)]
    return [s + h * t for s, t in zip(state, total)]


def film(
    start: list[float],
    force: Force,
    fps: float,
    count: int,
    contact: float | None = None,
    restitution: Callable[[float], float] = lambda speed: 0.0,
    fall: float = GRAVITY,
) -> Track:
    """A track of `count` pictures from x, y (m), vx, vy (m/s). At the height `contact` of its centre the ball bounces."""
    state, track, substeps = list(start), [], max(1, math.ceil(1 / (fps * STEP)))
    for i in range(count):
        track.append((i / fps, state[0], state[1]))
        for _ in range(substeps):
            h = 1 / (fps * substeps)
            after = step(state, force, h, fall)
            if contact is not None and after[1] < contact and state[3] < 0:
                low, high = 0.0, h
                while high - low > 1e-7:
                    middle = (low + high) / 2
                    low, high = (low, middle) if step(state, force, middle, fall)[1] < contact else (middle, high)
                state = step(state, force, low, fall)
                state[3] *= -restitution(-state[3])
                after = step(state, force, h - low, fall)
            state = after
    return track


def filmed(track: Track, noise: float, rng: random.Random) -> Track:
    """The track as a film shows it."""
    seen = []
    for t, x, y in track:
        sd = noise * (15 if rng.random() < 0.01 else 1)
        x, y = x * math.cos(TURN) - y * math.sin(TURN), x * math.sin(TURN) + y * math.cos(TURN)
        seen.append((t, x + rng.gauss(0, sd), y + rng.gauss(0, sd)))
    return seen


def drag(k: float, ux: float = 0.0) -> Force:
    """Quadratic drag, 1/m, in air that moves with `ux`, m/s."""

    def force(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
        speed = math.hypot(vx - ux, vy)
        return -k * speed * (vx - ux), -k * speed * vy

    return force


def none(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
    return 0.0, 0.0


def throws(rng: random.Random, count: int, speeds: tuple[float, float]) -> list[list[float]]:
    """Starts to the right and to the left at various angles."""
    result = []
    for i in range(count):
        speed = speeds[0] + (speeds[1] - speeds[0]) * i / (count - 1)
        angle = math.radians(rng.uniform(20, 70))
        result.append([0.0, rng.uniform(1.0, 1.4), speed * math.cos(angle) * (-1) ** i, speed * math.sin(angle)])
    return result


def write(folder: str, name: str, text: str, encoding: str = "utf-8") -> None:
    (HERE / folder).mkdir(exist_ok=True)
    (HERE / folder / name).write_bytes(text.encode(encoding))


def table(track: Track, header: str, separator: str = ",", comma: bool = False, digits: int = 5) -> str:
    lines = [separator.join(f"{v:.{digits}f}" for v in row) for row in track]
    return header + "".join((line.replace(".", ",") if comma else line) + "\n" for line in lines)


def film_of_bounces(rng: random.Random) -> None:
    """One film of a table-tennis ball, as TrackMate writes it."""
    start = [0.0, 0.9, 0.6, 0.0]
    track = filmed(film(start, drag(0.13), 120, 560, 0.02, lambda speed: 0.86), 0.001, rng)
    lines = ["LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME\n", "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame\n"]
    lines.append(",,,(quality),(m),(m),(m),(sec),\n")
    lines += [f"ID{i},{i},0,9.1,{x:.5f},{y:.5f},0.0,{t:.5f},{i}\n" for i, (t, x, y) in enumerate(track)]
    write("film_of_bounces", "spots.csv", "".join(lines))


def coffee_filters(rng: random.Random) -> None:
    """Coffee filters dropped from rest, as Tracker writes them."""
    for i in range(8):
        force = drag(4.0 * rng.gauss(1, 0.03))
        track = filmed(film([0.0, 2.0 + 0.05 * i, 0.0, 0.0], force, 60, 60), 0.001, rng)
        write("coffee_filters", f"drop{i + 1}.txt", table(track, "filter\nt\tx\ty\n", "\t"))


def spinning_ball(rng: random.Random) -> None:
    """A light ball with back spin: drag and lift; decimal commas, as Kinovea writes them."""
    for i, start in enumerate(throws(rng, 12, (4.0, 9.0))):
        spin, air = 0.6 * rng.gauss(1, 0.03), drag(0.1)

        def force(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
            ax, ay = air(x, y, vx, vy)
            return ax - spin * vy, ay + spin * vx

        track = filmed(film(start, force, 120, 80), 0.001, rng)
        text = "#Kinovea Trajectory data export\n#T X Y\n\n# ball\n" + table(track, "", " ", comma=True)
        write("spinning_ball", f"throw{i + 1:02}.txt", text)


def windy_day(rng: random.Random) -> None:
    """A foam ball thrown to both sides in a wind of 3 m/s."""
    for i, start in enumerate(throws(rng, 12, (4.0, 9.0))):
        track = filmed(film(start, drag(0.2 * rng.gauss(1, 0.03), 3.0), 120, 80), 0.001, rng)
        write("windy_day", f"throw{i + 1:02}.csv", table(track, "Time (s),X (m),Y (m)\n"))


def rolling_ball(rng: random.Random) -> None:
    """A snooker ball that rolls to either side, as Logger Pro writes it."""
    for i in range(10):
        side, start = (-1) ** i, [0.0, 0.02625, (0.6 + 0.15 * i) * (-1) ** i, 0.0]
        slow = 0.012 * rng.gauss(1, 0.03) * GRAVITY
        track = film(start, lambda x, y, vx, vy: (-side * slow, 0.0), 30, 60, fall=0.0)
        header = "VideoAnalysis: Time (s)\tVideoAnalysis: X (m)\tVideoAnalysis: Y (m)\n"
        write("rolling_ball", f"roll{i + 1:02}.txt", table(filmed(track, 0.001, rng), header, "\t"))


def wrong_clock(rng: random.Random) -> None:
    """A steel ball in slow motion: 120 pictures a second that the program took for 100."""
    for i, start in enumerate(throws(rng, 8, (3.0, 7.0))):
        track = [(1.2 * t, x, y) for t, x, y in film(start, none, 120, 70)]
        write("wrong_clock", f"throw{i + 1}.csv", table(filmed(track, 0.001, rng), "t,x,y\n"))


def motion_capture(rng: random.Random) -> None:
    """A ball thrown in all directions of a room, as Qualisys writes it: three coordinates in mm at 100 Hz."""
    for i, start in enumerate(throws(rng, 10, (4.0, 9.0))):
        track = filmed(film(start, drag(0.13 * rng.gauss(1, 0.03)), 100, 70), 0.0007, rng)
        azimuth = rng.uniform(0, math.pi)
        lines = ["NO_OF_FRAMES\t70\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t1\nFREQUENCY\t100\nDATA_INCLUDED\t3D\nMARKER_NAMES\tball\n"]
        for _, x, y in track:
            across = rng.gauss(0, 0.0007)
            room = (x * math.cos(azimuth) - across * math.sin(azimuth), x * math.sin(azimuth) + across * math.cos(azimuth), y)
            lines.append("\t".join(f"{1000 * v:.3f}" for v in room) + "\n")
        write("motion_capture", f"throw{i + 1:02}.tsv", "".join(lines))


def steel_ball(rng: random.Random) -> None:
    """A steel ball, on which air has no visible effect; a spreadsheet's UTF-16."""
    for i, start in enumerate(throws(rng, 10, (3.0, 7.0))):
        track = filmed(film(start, none, 120, 70), 0.001, rng)
        write("steel_ball", f"throw{i + 1:02}.txt", table(track, "t\tx\ty\n(s)\t(m)\t(m)\n", "\t"), "utf-16")


def whirl(rng: random.Random) -> None:
    """A balloon in a draught that circles about a place: in no library of effects."""

    def force(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
        dx, dy = x - 0.3, y - 1.6
        size = 2.5 * math.exp(-(dx * dx + dy * dy) / 0.8)
        return -size * dy, size * dx

    for i, start in enumerate(throws(rng, 14, (3.0, 6.0))):
        track = filmed(film(start, force, 120, 80), 0.001, rng)
        write("whirl", f"throw{i + 1:02}.csv", table(track, "t,x,y\n"))


def soft_ball(rng: random.Random) -> None:
    """A soft ball that loses more in harder bounces; pixels of 2 mm at 240 pictures a second, as DeepLabCut writes them."""
    for i in range(10):
        force, start = none, [0.1, 0.4 + 0.16 * i, 0.3, 0.0]
        track = filmed(film(start, force, 240, 340, 0.03, lambda speed: 0.9 - 0.035 * speed), 0.001, rng)
        lines = ["scorer,net,net,net\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n"]
        lines += [f"{k},{x / 0.002:.3f},{1000 - y / 0.002:.3f},0.99\n" for k, (_, x, y) in enumerate(track)]
        write("soft_ball", f"drop{i + 1:02}.csv", "".join(lines))


def main() -> None:
    makers = (
        film_of_bounces, coffee_filters, spinning_ball, windy_day, rolling_ball, wrong_clock, motion_capture, steel_ball, whirl, soft_ball,
    )
    for i, make in enumerate(makers):
        make(random.Random(i))


if __name__ == "__main__":
    main()
