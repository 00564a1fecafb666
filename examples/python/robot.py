"""A robot with a world of its own: the server proposes, the robot carries out and tells what its cameras saw.

The robot is Pymunk: another engine, true friction and restitution that only it knows, and air that the server's
simulation does not have (damping 0.8). It shares nothing with the server but HTTP: proposals come as scenes with
everything placed, and go back as times and positions. At the end the estimate stands beside the truth.

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

#: What the robot's world is made of; the server is never told.
TRUTH = {"density": 0.25, "friction": 0.707, "restitution": 0.447}
DAMPING = 0.8
#: The robot's cameras see that much later, s, than the server would look, and that badly, m.
LATE = 0.013
NOISE = 0.002


def build(scene: dict[str, Any]) -> tuple[pymunk.Space, dict[str, pymunk.Body]]:
    """The robot's version of a scene: same places and shapes, its own physics for what moves."""
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
        surface(shape, fixed, fixed["name"] in carriers)
        space.add(shape)
    bodies = {}
    for separate in scene["bodies"]:
        radius = separate["shape"]["radius"]
        mass = TRUTH["density"] * math.pi * radius**2
        body = pymunk.Body(mass, mass * radius**2 / 2)
        body.position, body.angle = tuple(separate["position"]), separate.get("angle", 0.0)
        body.velocity = tuple(separate.get("velocity", (0.0, 0.0)))
        disc = pymunk.Circle(body, radius)
        surface(disc, separate, separate["name"] in carriers)
        space.add(body, disc)
        bodies[separate["name"]] = body
    return space, bodies


def surface(shape: pymunk.Shape, created: dict[str, Any], carrier: bool) -> None:
    """Hidden coefficients for what carries the latent factors, the scene's for everything else."""
    physics = TRUTH if carrier else created
    shape.friction, shape.elasticity = physics.get("friction", 1.0), physics.get("restitution", 1.0)


def outline(body: pymunk.Body, shape: dict[str, Any], placed: pymunk.Transform) -> pymunk.Shape:
    """A static's shape where it stands."""

    def at(point: tuple[float, float]) -> tuple[float, float]:
        x, y = point
        return (placed.a * x + placed.c * y + placed.tx, placed.b * x + placed.d * y + placed.ty)

    match shape["type"]:
        case "segment":
            return pymunk.Segment(body, at(shape["from"]), at(shape["to"]), shape.get("radius", 0.0))
        case "polygon":
            return pymunk.Poly(body, [at(point) for point in shape["vertices"]])
        case "box":
            w, h = shape["half_width"], shape["half_height"]
            return pymunk.Poly(body, [at(p) for p in ((-w, -h), (w, -h), (w, h), (-w, h))])
        case other:
            raise ValueError(f"the robot has no {other}")


def carry_out(
    proposal: iplw.Proposal, camera: np.random.Generator
) -> tuple[list[float], dict[str, NDArray[np.float64]]]:
    """Lets the bodies go and films them, at times of the robot's own."""
    space, bodies = build(proposal.scene)
    step = 1.0 / 240.0
    ticks = [0, *(math.ceil((t + LATE) / step) for t in proposal.observe_at[1:])]
    observed = []
    for before, now in zip([0, *ticks], ticks):
        for _ in range(now - before):
            space.step(step)
        observed.append([tuple(body.position) for body in bodies.values()])
    states = np.array(observed)
    # Where things were let go is known; where they went is seen.
    states[1:] += camera.normal(0.0, NOISE, states[1:].shape)
    return [tick * step for tick in ticks], {name: states[:, i] for i, name in enumerate(bodies)}


def main() -> None:
    """Runs the workflow against the robot."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--url", help="address of a server; a private one is started without")
    parser.add_argument("--task", default="bowling", choices=["bowling", "basketball"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--actions", type=int, default=8, help="proposals a round")
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
                response = job.tell(proposal, *carry_out(proposal, camera))
            print(f"round {proposals[0].round + 1}: {response['fetch']} proposals carried out")
        result = job.wait()
    print(f"\n{'latent':12} {'truth':>8} {'estimate':>9}  95 % interval")
    for row in result["latents"]:
        name, truth = row["name"], TRUTH[row["name"]]
        if not row["identifiable"]:
            print(f"{name:12} {truth:8.3f} {'-':>9}  these trials cannot tell")
            continue
        low, high = row["ci95"]
        print(f"{name:12} {truth:8.3f} {row['value']:9.3f}  {low:.3f} to {high:.3f}")
    print(f"{result['real_interactions']} interactions; the robot's air (damping {DAMPING}) is not in the model")


if __name__ == "__main__":
    main()
