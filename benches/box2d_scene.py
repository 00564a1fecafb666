"""Builds a Box2D world from an `iplw.scene/1` scene, and evaluates its goal as PHYRE does.

Box2D 2.3.10 from PyPI supports only the contact rules that a scene calls `geometric_mean`, `max` and 1.0. Statics are
created first, in reverse order: Box2D visits the newest contacts first, and the order matters if its iterations do not
converge.
"""

import math
from dataclasses import dataclass

import Box2D


@dataclass(frozen=True)
class How:
    """Settings of Box2D; the defaults are PHYRE's."""

    #: Velocity and position iterations per step.
    iterations: tuple = (15, 20)
    #: Continuous collision detection with statics.
    continuous: bool = True
    #: Skin of polygons, m; None: Box2D's 0.01.
    skin: float | None = None
    #: Angular damping, 1/s.
    angular_damping: float = 0.01
    #: Create statics and bodies in reverse order.
    reverse: bool = False


PHYRE = How()


def build(scene, how=PHYRE):
    """(world, bodies and statics by name)."""
    world = Box2D.b2World(gravity=tuple(scene["gravity"]), continuousPhysics=how.continuous)
    statics, bodies = scene.get("statics", [])[::-1], scene["bodies"]
    if how.reverse:
        statics, bodies = statics[::-1], bodies[::-1]
    return world, {own["name"]: _body(world, own, own in bodies, how) for own in [*statics, *bodies]}


def solved(scene, how=PHYRE):
    """Whether the goal's bodies touch for its `hold_s` on end: discs by distance, others while Box2D has a contact."""
    world, things = build(scene, how)
    one, other = (things[name] for name in scene["goal"]["bodies"])
    shapes = [thing.fixtures[0].shape for thing in (one, other)]
    discs = all(isinstance(shape, Box2D.b2CircleShape) for shape in shapes)
    within = sum(shape.radius for shape in shapes) + scene["goal"]["tolerance"]
    needed, held = math.ceil(scene["goal"]["hold_s"] / scene["time_step"] - 1e-9), 0
    for _ in range(scene["steps"]):
        world.Step(scene["time_step"], *how.iterations)
        if discs:
            touches = (one.position - other.position).length < within
        else:
            touches = any(edge.other == other and edge.contact.touching for edge in one.contacts)
        held = held + 1 if touches else 0
        if held >= needed:
            return True
    return False


def _body(world, own, moves, how):
    make = world.CreateDynamicBody if moves else world.CreateStaticBody
    body = make(position=tuple(own.get("position", (0.0, 0.0))), angle=own.get("angle", 0.0), linearDamping=0.0,
                angularDamping=how.angular_damping)
    shape = own["shape"]
    for piece in shape["pieces"] if shape["type"] == "compound" else [shape]:
        body.CreateFixture(shape=_shape(piece), density=own.get("density", 1.0) if moves else 0.0,
                           friction=own["friction"], restitution=own["restitution"])
    if how.skin is not None:
        for fixture in body.fixtures:
            if isinstance(fixture.shape, Box2D.b2PolygonShape):
                fixture.shape.radius = how.skin
    if moves:
        body.linearVelocity = tuple(own.get("velocity", (0.0, 0.0)))
        body.angularVelocity = own.get("angular_velocity", 0.0)
    return body


def _shape(shape):
    """A fixture's shape; its frame is the body's (a piece's own `position` and `angle` are carried over)."""
    at, angle = tuple(shape.get("position", (0.0, 0.0))), shape.get("angle", 0.0)
    sin, cos = math.sin(angle), math.cos(angle)
    if shape["type"] == "disc":
        return Box2D.b2CircleShape(radius=shape["radius"], pos=at)
    if shape["type"] == "box":
        w, h = shape["half_width"], shape["half_height"]
        corners = [(-w, -h), (w, -h), (w, h), (-w, h)]
    elif shape["type"] == "polygon":
        corners = shape["vertices"]
    else:
        raise ValueError(f"no Box2D shape for {shape['type']}")
    return Box2D.b2PolygonShape(vertices=[(at[0] + cos * x - sin * y, at[1] + sin * x + cos * y) for x, y in corners])
