"""Builds a Pymunk space from an `iplw.scene/1` scene: Pymunk's own defaults, nothing tuned."""

import math

import pymunk


def build(scene, slop=None):
    """(space, bodies in the scene's order). Products of coefficients are Pymunk's rule already."""
    space = pymunk.Space()
    space.gravity = tuple(scene.get("gravity", [0.0, -9.8]))
    space.damping = scene.get("damping") or 1.0
    if slop is not None:
        space.collision_slop = slop
    for fixed in scene.get("statics", []):
        position, angle = fixed.get("position", [0.0, 0.0]), fixed.get("angle", 0.0)
        shape = _shape(space.static_body, fixed["shape"], pymunk.Transform(
            math.cos(angle), math.sin(angle), -math.sin(angle), math.cos(angle), *position))
        _add(space, shape, fixed)
    bodies = []
    for own in scene["bodies"]:
        radius = own["shape"]["radius"]
        mass = own.get("mass") or (own.get("density") or 1.0) * math.pi * radius * radius
        body = pymunk.Body(mass, mass * radius * radius / 2)
        body.position = tuple(own["position"])
        body.angle = own.get("angle", 0.0)
        body.velocity = tuple(own.get("velocity", [0.0, 0.0]))
        body.angular_velocity = own.get("angular_velocity", 0.0)
        space.add(body)
        _add(space, pymunk.Circle(body, radius), own)
        bodies.append(body)
    return space, bodies


def _add(space, shape, surface):
    shape.friction = surface.get("friction", 1.0)
    shape.elasticity = surface.get("restitution", 1.0)
    space.add(shape)


def _shape(body, shape, placed):
    at = lambda p: (placed.a * p[0] + placed.c * p[1] + placed.tx, placed.b * p[0] + placed.d * p[1] + placed.ty)
    kind = shape["type"]
    if kind == "disc":
        return pymunk.Circle(body, shape["radius"], at((0, 0)))
    if kind == "segment":
        return pymunk.Segment(body, at(shape["from"]), at(shape["to"]), shape.get("radius", 0.0))
    if kind == "polygon":
        return pymunk.Poly(body, [at(p) for p in shape["vertices"]])
    if kind == "box":
        w, h = shape["half_width"], shape["half_height"]
        return pymunk.Poly(body, [at(p) for p in ((-w, -h), (w, -h), (w, h), (-w, h))])
    raise ValueError(f"no Pymunk shape for {kind}")
