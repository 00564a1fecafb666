"""An ask/tell estimation with an external robot: the server proposes actions, the robot executes them and reports measurements.

The robot is simulated with Pymunk, a different engine, with hidden friction and restitution, and with a damping (0.8) that
the server's model lacks. The two communicate only over HTTP: proposals are received as scenes with all bodies placed, and
results are returned as times and positions. At the end the estimate is compared with the true values.

    pip install iplw pymunk && python examples/python/robot.py
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np
import pymunk
from numpy.typing import NDArray

import iplw

#: Latents of the robot's world, unknown to the server.
TRUTH = {"density": 0.25, "friction": 0.707, "restitution": 0.447}
DAMPING = 0.8
#: Delay of the robot's cameras relative to the requested times, s, and their noise, m.
DELAY = 0.013
NOISE = 0.002


def build(scene: dict[str, Any]) -> tuple[pymunk.Space, dict[str, pymunk.Body]]:
    """The robot's version of a scene: the same positions and shapes, with the robot's physics for moving bodies."""
    space = pymunk.Space()
    space.gravity = tuple(scene.get("gravity", (0.0, -9.8)))
    space.damping = DAMPING
    movable = {body["name"] for body in scene["bodies"]}
    carriers = set(scene.get("carriers") or movable)
    for fixed in scene["statics"]:
        x, y = fixed.get("position", (0.0, 0.0))
        turn = fixed.get("angle", 0.0)
        cos, sin = math.cos(turn), math.sin(turn)
        shape = outline(space.static_body, fixed["shape"], pymunk.Transform(cos, sin, -sin, cos, x, y))
        set_surface(shape, fixed, fixed["name"] in carriers)
        space.add(shape)
    bodies = {}
    for item in scene["bodies"]:
        radius = item["shape"]["radius"]
        mass = TRUTH["density"] * math.pi * radius**2
        body = pymunk.Body(mass, mass * radius**2 / 2)
        body.position, body.angle = tuple(item["position"]), item.get("angle", 0.0)
        body.velocity = tuple(item.get("velocity", (0.0, 0.0)))
        disc = pymunk.Circle(body, radius)
        set_surface(disc, item, item["name"] in carriers)
        space.add(body, disc)
        bodies[item["name"]] = body
    return space, bodies


def set_surface(shape: pymunk.Shape, item: dict[str, Any], carrier: bool) -> None:
    """The hidden coefficients for carriers of the latents, the scene's values otherwise."""
    physics = TRUTH if carrier else item
    shape.friction, shape.elasticity = physics.get("friction", 1.0), physics.get("restitution", 1.0)


def outline(body: pymunk.Body, shape: dict[str, Any], transform: pymunk.Transform) -> pymunk.Shape:
    """A static's shape at its position."""

    def at(point: tuple[float, float]) -> tuple[float, float]:
        x, y = point
        return (transform.a * x + transform.c * y + transform.tx, transform.b * x + transform.d * y + transform.ty)

    match shape["type"]:
        case "segment":
            return pymunk.Segment(body, at(shape["from"]), at(shape["to"]), shape.get("radius", 0.0))
        case "polygon":
            return pymunk.Poly(body, [at(point) for point in shape["vertices"]])
        case "box":
            w, h = shape["half_width"], shape["half_height"]
            return pymunk.Poly(body, [at(p) for p in ((-w, -h), (w, -h), (w, h), (-w, h))])
        case other:
            raise ValueError(f"shape {other!r} is not supported by the robot")


def execute(
    proposal: iplw.Proposal, camera: np.random.Generator
) -> tuple[list[float], dict[str, NDArray[np.float64]]]:
    """Releases the bodies and measures their trajectories, at the robot's times."""
    space, bodies = build(proposal.scene)
    step = 1.0 / 240.0
    ticks = [0, *(math.ceil((t + DELAY) / step) for t in proposal.observe_at[1:])]
    observed = []
    for before, now in zip([0, *ticks], ticks):
        for _ in range(now - before):
            space.step(step)
        observed.append([tuple(body.position) for body in bodies.values()])
    states = np.array(observed)
    # Initial positions are exact, later ones are measured.
    states[1:] += camera.normal(0.0, NOISE, states[1:].shape)
    return [tick * step for tick in ticks], {name: states[:, i] for i, name in enumerate(bodies)}


def main() -> None:
    """Runs the estimation workflow with the robot."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--url", help="address of a server; default: a private one is started")
    parser.add_argument("--task", default="bowling", choices=["bowling", "basketball"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--actions", type=int, default=8, help="proposals per round")
    parser.add_argument("--samples", type=int, default=None, help="latent samples per iteration of the search")
    parser.add_argument("--residual", default="shooting", choices=["trajectory", "shooting"])
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    camera = np.random.default_rng(args.seed)
    with iplw.Client(args.url, timeout=120) as client:
        job = client.iplw(
            args.task,
            real="ask_tell",
            residual=args.residual,
            rounds=args.rounds,
            actions=args.actions,
            samples=args.samples,
            seed=args.seed,
        )
        while proposals := job.proposals():
            response: dict[str, Any] = {}
            for proposal in proposals:
                response = job.tell(proposal, *execute(proposal, camera))
            print(f"round {proposals[0].round + 1}: {response['answered']} proposals executed")
        result = job.wait()
    print(f"\n{'latent':12} {'truth':>8} {'estimate':>9}  95 % interval")
    for row in result["latents"]:
        name, truth = row["name"], TRUTH[row["name"]]
        if not row["identifiable"]:
            print(f"{name:12} {truth:8.3f} {'-':>9}  not identifiable from these trials")
            continue
        low, high = row["ci95"]
        print(f"{name:12} {truth:8.3f} {row['value']:9.3f}  {low:.3f} to {high:.3f}")
    print(f"{result['real_interactions']} interactions; the robot's damping ({DAMPING}) is not in the model")


if __name__ == "__main__":
    main()
