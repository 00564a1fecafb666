"""PHYRE's ball-tier tasks as `iplw.scene/1`, read from one JSON object by task id: see `phyre_templates.py`.

These rules are from PHYRE's source code (facebookresearch/phyre: `action_mappers.py`, `geometry.h`,
`task_utils.h`, `task_validation.cpp`, `thrift_box2d_conversion.cpp`):

- An action's ball is snapped to the pixel grid: x and y are truncated, the radius is rounded. Without this, an eighth of
  the stable solutions does not solve its task in Box2D.
- The ball must lie within the scene before snapping, and overlap no body by more than 1e-5 px after it.
- Two balls touch within 0.1 px; other bodies touch while Box2D has a contact, which includes the skins of its polygons,
  0.01 m each.
- 1000 steps of 1/60 s; contact for 180 consecutive steps solves the task.
"""

import gzip
import json
import math
import random

PIXELS_PER_METRE = 6.0
SIDE_PIXELS = 256
GRAVITY, DENSITY, FRICTION, RESTITUTION = -9.8, 0.25, 0.5, 0.2
SECONDS, HOLD_SECONDS = 1000 / 60, 3.0
#: Maximum gap between touching balls, m.
BALLS_TOUCH = 0.1 / PIXELS_PER_METRE
#: Skin of a polygon in Box2D, m.
SKIN = 0.01
INSIDE_PIXELS = 1e-5
BOX2D_RULES = {"friction": "geometric_mean", "restitution": "max", "restitution_threshold": 1.0}


def load(path):
    """Tasks by template: {"00000": [(id, task), ...], ...}; plain or gzipped JSON."""
    with (gzip.open if path.endswith(".gz") else open)(path, "rt") as file:
        tasks = json.load(file)
    templates = {}
    for name in sorted(tasks):
        templates.setdefault(name.split(":")[0], []).append((name, tasks[name]))
    return templates


def scene(name, task, action, rate, rules=BOX2D_RULES):
    """The task with the action's red ball (None: without it), at `rate` steps per second; names are kind and index.

    Statics are listed from the last to the first: ours visits a body's contacts as they are listed, Box2D the newest
    first, and which of two is visited last decides what a disc in a notch does when it is hit (template 00015).
    """
    own = [*task["bodies"]]
    if action is not None:
        x, y, r = red_ball(action)
        own.append({"x": x, "y": y, "angle": 0.0, "dynamic": True, "kind": "red", "shapes": [{"circle": r}]})
    names = [f"{body['kind'] or 'wall'}{i}" for i, body in enumerate(own)]
    pair = [task["goal"][key] for key in ("body1", "body2")]
    things = [said(label, body) for label, body in zip(names, own)]
    return {
        "format": "iplw.scene/1",
        "name": name,
        "gravity": [0.0, GRAVITY],
        "bodies": [thing for thing, body in zip(things, own) if body["dynamic"]],
        "statics": [thing for thing, body in reversed(list(zip(things, own))) if not body["dynamic"]],
        "time_step": 1 / rate,
        "steps": round(SECONDS * rate),
        "observe_every": round(SECONDS * rate),
        "contact_rules": rules,
        "goal": {"type": "contact", "bodies": [names[i] for i in pair], "hold_s": HOLD_SECONDS,
                 "tolerance": reach(*(task["bodies"][i] for i in pair))},
    }


def said(name, body):
    """A body or static of a scene."""
    pieces = [outline(shape) for shape in body["shapes"]]
    thing = {
        "name": name,
        "shape": pieces[0] if len(pieces) == 1 else {"type": "compound", "pieces": pieces},
        "position": [body["x"] / PIXELS_PER_METRE, body["y"] / PIXELS_PER_METRE],
        "angle": body["angle"],
        "friction": FRICTION,
        "restitution": RESTITUTION,
    }
    return {**thing, "density": DENSITY} if body["dynamic"] else thing


def outline(shape):
    if "circle" in shape:
        return {"type": "disc", "radius": shape["circle"] / PIXELS_PER_METRE}
    return {"type": "polygon", "vertices": [[x / PIXELS_PER_METRE, y / PIXELS_PER_METRE] for x, y in shape["polygon"]]}


def reach(one, other):
    """Maximum gap between bodies that touch according to PHYRE, m."""
    skinned = sum("circle" not in body["shapes"][0] for body in (one, other))
    return SKIN * skinned if skinned else BALLS_TOUCH


def red_ball(action):
    """x, y and radius on PHYRE's grid, px."""
    x, y, r = continuous(action)
    return int(x), int(y), round(r)


def continuous(action):
    x, y, r = action
    return x * (SIDE_PIXELS - 1), y * (SIDE_PIXELS - 1), 2 + 30 * r


def valid_actions(name, task, count):
    """`count` random actions that are valid in PHYRE; the task's name is the seed."""
    draw = random.Random(f"phyre {name}")
    actions = []
    while len(actions) < count:
        action = [draw.random() for _ in range(3)]
        x, y, r = continuous(action)
        if r <= x <= SIDE_PIXELS - r and r <= y <= SIDE_PIXELS - r and not overlaps(task, *red_ball(action)):
            actions.append(action)
    return actions


def overlaps(task, x, y, r):
    for body in task["bodies"]:
        sin, cos = math.sin(body["angle"]), math.cos(body["angle"])
        dx, dy = x - body["x"], y - body["y"]
        at = (cos * dx + sin * dy, cos * dy - sin * dx)
        if any(gap(shape, at) + INSIDE_PIXELS < r for shape in body["shapes"]):
            return True
    return False


def gap(shape, at):
    """Distance of a point in the body's frame from the shape, px; at most 0 inside."""
    if "circle" in shape:
        return math.hypot(*at) - shape["circle"]
    corners = shape["polygon"]
    edges = list(zip(corners, corners[1:] + corners[:1]))
    if all((q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0]) > 0 for p, q in edges):
        return 0.0
    return min(from_edge(p, q, at) for p, q in edges)


def from_edge(p, q, at):
    along = (q[0] - p[0], q[1] - p[1])
    share = ((at[0] - p[0]) * along[0] + (at[1] - p[1]) * along[1]) / (along[0] ** 2 + along[1] ** 2)
    share = min(1.0, max(0.0, share))
    return math.hypot(at[0] - p[0] - share * along[0], at[1] - p[1] - share * along[1])


def own_rate(task):
    """(share of valid random actions that solve the task in PHYRE, number of valid ones)."""
    counts = task["random_actions"]
    solved = counts["2"] + counts["3"]
    valid = solved + counts["-1"]
    return solved / valid, valid
