"""Builds a Pymunk space from an `iplw.scene/1` scene with Pymunk's defaults."""

import math

import pymunk


def build(scene, slop=None):
    """(space, bodies in the scene's order). Pymunk also combines coefficients by their product."""
    space = pymunk.Space()
    space.gravity = tuple(scene.get("gravity", [0.0, -9.8]))
    space.damping = scene.get("damping") or 1.0
    if slop is not None:
        space.collision_slop = slop
    for fixed in scene.get("statics", []):
        position, angle = fixed.get("position", [0.0, 0.0]), fixed.get("angle", 0.0)
        stands = pymunk.Transform(math.cos(angle), math.sin(angle), -math.sin(angle), math.cos(angle), *position)
        for shape, placed in _pieces(fixed["shape"]):
            _add(space, _shape(space.static_body, shape, stands @ placed), fixed)
    bodies = []
    for own in scene["bodies"]:
        pieces = list(_pieces(own["shape"]))
        area, centre, second = _moments(pieces)
        mass = own.get("mass") or (own.get("density") or 1.0) * area
        body = pymunk.Body(mass, mass * second)
        body.center_of_gravity = centre
        body.angle = own.get("angle", 0.0)
        body.position = tuple(own["position"])
        spin, arm = own.get("angular_velocity", 0.0), pymunk.Vec2d(*centre).rotated(body.angle)
        # Pymunk's velocity is that of the centre of mass, ours that of the body frame's origin.
        body.velocity = pymunk.Vec2d(*own.get("velocity", (0.0, 0.0))) + spin * arm.perpendicular()
        body.angular_velocity = spin
        space.add(body)
        for shape, placed in pieces:
            _add(space, _shape(body, shape, placed), own)
        bodies.append(body)
    return space, bodies


def _pieces(shape):
    """Convex shapes with their poses in the body's frame."""
    if shape["type"] != "compound":
        yield shape, pymunk.Transform.identity()
        return
    for piece in shape["pieces"]:
        angle, at = piece.get("angle", 0.0), piece.get("position", (0.0, 0.0))
        sin, cos = math.sin(angle), math.cos(angle)
        yield piece, pymunk.Transform(cos, sin, -sin, cos, *at)


def _moments(pieces):
    """Area, m^2; centre of mass, m; second moment about it over the area, m^2."""
    parts = []
    for shape, placed in pieces:
        area, centre, second = _own_moments(shape)
        parts.append((area, _at(placed, centre), second))
    total = sum(area for area, _, _ in parts)
    x, y = (sum(area * c[k] for area, c, _ in parts) / total for k in (0, 1))
    second = sum(a * (s + (c[0] - x) ** 2 + (c[1] - y) ** 2) for a, c, s in parts) / total
    return total, (x, y), second


def _own_moments(shape):
    kind = shape["type"]
    if kind == "disc":
        radius = shape["radius"]
        return math.pi * radius**2, (0.0, 0.0), radius**2 / 2
    if kind == "segment":
        (x0, y0), (x1, y1), r = shape["from"], shape["to"], shape["radius"]
        length = math.hypot(x1 - x0, y1 - y0)
        bar, ends = 2 * r * length, math.pi * r**2
        of_ends = r**2 / 2 + length**2 / 4 + length * 4 * r / (3 * math.pi)
        second = (bar * (length**2 + 4 * r**2) / 12 + ends * of_ends) / (bar + ends)
        return bar + ends, ((x0 + x1) / 2, (y0 + y1) / 2), second
    corners = _corners(shape)
    area = pymunk.area_for_poly(corners)
    cross = [(p, q, p[0] * q[1] - p[1] * q[0]) for p, q in zip(corners, corners[1:] + corners[:1])]
    x, y = (sum(c * (p[k] + q[k]) for p, q, c in cross) / (6 * area) for k in (0, 1))
    about_origin = pymunk.moment_for_poly(1.0, corners)
    return area, (x, y), about_origin - x * x - y * y


def _corners(shape):
    if shape["type"] == "polygon":
        return [tuple(p) for p in shape["vertices"]]
    w, h = shape["half_width"], shape["half_height"]
    return [(-w, -h), (w, -h), (w, h), (-w, h)]


def _add(space, shape, surface):
    shape.friction = surface.get("friction", 1.0)
    shape.elasticity = surface.get("restitution", 1.0)
    space.add(shape)


def _at(placed, p):
    return (placed.a * p[0] + placed.c * p[1] + placed.tx, placed.b * p[0] + placed.d * p[1] + placed.ty)


def _shape(body, shape, placed):
    kind = shape["type"]
    if kind == "disc":
        return pymunk.Circle(body, shape["radius"], _at(placed, (0, 0)))
    if kind == "segment":
        return pymunk.Segment(body, _at(placed, shape["from"]), _at(placed, shape["to"]), shape.get("radius", 0.0))
    if kind in ("polygon", "box"):
        return pymunk.Poly(body, [_at(placed, p) for p in _corners(shape)])
    raise ValueError(f"no Pymunk shape for {kind}")
