"""Builds a Box2D world from an `iplw.scene/1` scene, and judges its goal as PHYRE does. Box2D 2.3.10 of PyPI: its rules of contact are
those that a scene calls `geometric_mean`, `max` and 1.0, and it knows no others.

Statics are made first, and from the last to the first: Box2D visits the newest contacts first, and the order matters where its
iterations do not converge.
"""

import math

import Box2D

#: Damping that PHYRE gives its bodies, 1/s.
ANGULAR_DAMPING = 0.01
#: PHYRE's iterations of velocities and positions a step.
ITERATIONS = (15, 20)


def build(scene, angular_damping=ANGULAR_DAMPING):
    """(world, bodies and statics by name)."""
    world = Box2D.b2World(gravity=tuple(scene["gravity"]))
    things = {}
    for own in [*reversed(scene.get("statics", [])), *scene["bodies"]]:
        moves = "density" in own
        make = world.CreateDynamicBody if moves else world.CreateStaticBody
        body = make(position=tuple(own.get("position", (0.0, 0.0))), angle=own.get("angle", 0.0), linearDamping=0.0,
                    angularDamping=angular_damping)
        shape = own["shape"]
        for piece in shape["pieces"] if shape["type"] == "compound" else [shape]:
            body.CreateFixture(shape=_shape(piece), density=own["density"] if moves else 0.0, friction=own["friction"],
                               restitution=own["restitution"])
        if moves:
            body.linearVelocity = tuple(own.get("velocity", (0.0, 0.0)))
            body.angularVelocity = own.get("angular_velocity", 0.0)
        things[own["name"]] = body
    return world, things


def solved(scene):
    """Whether the two bodies of the goal touch for its `hold_s` on end: discs by distance, others while Box2D has a contact."""
    world, things = build(scene)
    one, other = (things[name] for name in scene["goal"]["bodies"])
    shapes = [thing.fixtures[0].shape for thing in (one, other)]
    discs = all(isinstance(shape, Box2D.b2CircleShape) for shape in shapes)
    within = sum(shape.radius for shape in shapes) + scene["goal"]["tolerance"]
    needed, held = math.ceil(scene["goal"]["hold_s"] / scene["time_step"] - 1e-9), 0
    for _ in range(scene["steps"]):
        world.Step(scene["time_step"], *ITERATIONS)
        if discs:
            touches = (one.position - other.position).length < within
        else:
            touches = any(edge.other == other and edge.contact.touching for edge in one.contacts)
        held = held + 1 if touches else 0
        if held >= needed:
            return True
    return False


def _shape(shape):
    """A fixture's shape; its frame is the body's (a piece's own `position` and `angle` are carried over)."""
    at, angle = tuple(shape.get("position", (0.0, 0.0))), shape.get("angle", 0.0)
    if shape["type"] == "disc":
        return Box2D.b2CircleShape(radius=shape["radius"], pos=at)
    if shape["type"] == "box":
        return Box2D.b2PolygonShape(box=(shape["half_width"], shape["half_height"], at, angle))
    if shape["type"] == "polygon":
        sin, cos = math.sin(angle), math.cos(angle)
        return Box2D.b2PolygonShape(vertices=[(at[0] + cos * x - sin * y, at[1] + sin * x + cos * y)
                                              for x, y in shape["vertices"]])
    raise ValueError(f"no Box2D shape for {shape['type']}")
