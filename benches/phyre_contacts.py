"""Differences between our contacts and Box2D's: three small scenes, and PHYRE's solutions in Box2D with one setting changed.

    python benches/phyre_contacts.py target/release/iplw [phyre_b.json.gz [--template ID ...] [--tasks N]]

Each scene runs in `lanes`, in Pymunk (with Box2D's contact rules by a callback; also with Box2D's slop of 5 mm, and
additionally with a skin of 1 cm) and in Box2D (also without continuous collision or polygon skin, with fewer and
more iterations, and with objects created in reverse order):

- *drop*: a disc of radius 1.25 m falls 8.55 m onto a floor; its height about the impact and at rest, m.
- *notch*: a disc lies between two bars and is hit by a larger one; its displacement, m, for both orders of the bars.
- *bar*: an upright bar, 0.85 by 18.1 m, with an initial spin of 0.02 rad/s; its tilt, mrad.

Steps are 1/60 s. Box2D's steps are counted from 1, since it moves bodies after accelerating them and ours before; the
integrators are otherwise the same.

With a task file (see `phyre_templates.py`): the first solution of each of the first N (25) tasks of a template in
Box2D with PHYRE's settings, and with one setting changed at a time.
"""

import argparse
import json
import math
import subprocess

import box2d_scene
import phyre_tasks
import pymunk
import pymunk_scene
from box2d_scene import How

RATE = 60
SURFACE = {"friction": 0.5, "restitution": 0.2}
CHANGED = {
    "as PHYRE": How(),
    "no continuous": How(continuous=False),
    "no skin": How(skin=0.0),
    "10 iterations": How(iterations=(10, 20)),
    "100 iterations": How(iterations=(100, 20)),
    "reversed": How(reverse=True),
    "no damping": How(angular_damping=0.0),
}


def main():
    parser = argparse.ArgumentParser(description="Where our contacts and Box2D's part")
    parser.add_argument("binary")
    parser.add_argument("data", nargs="?", help="task file, for the ablation of Box2D's settings")
    parser.add_argument("--template", nargs="*", help="restrict to these templates")
    parser.add_argument("--tasks", type=int, default=25, metavar="N", help="number of tasks per template")
    options = parser.parse_args()
    show(options.binary, "drop: height, m", drop(), "disc", 1, [79, 80, 81, 90, 100, 178])
    show(options.binary, "notch: x, m", notch(False), "disc", 0, [86, 88, 100, 140, 180])
    show(options.binary, "notch, bars the other way round: x, m", notch(True), "disc", 0, [86, 88, 100, 140, 180])
    show(options.binary, "bar: tilt, rad", bar(), "bar", 2, [30, 60, 120, 180, 240, 300, 420, 600])
    if options.data:
        for template, tasks in phyre_tasks.load(options.data).items():
            if not options.template or template in options.template:
                print(template, ablation(tasks[:options.tasks]), flush=True)


def ablation(tasks):
    scenes = [phyre_tasks.scene(name, task, task["solutions"][0], RATE) for name, task in tasks]
    found = {label: sum(box2d_scene.solved(scene, how) for scene in scenes) for label, how in CHANGED.items()}
    return f"of {len(scenes)}: " + ", ".join(f"{label} {count}" for label, count in found.items())


def show(binary, title, scene, name, which, steps):
    ways = {"lanes": lanes(binary, scene), "Pymunk": in_pymunk(scene),
            "Pymunk, 100 sweeps": in_pymunk(scene, sweeps=100), "Pymunk, slop 5 mm": in_pymunk(scene, slop=0.005),
            "Pymunk, skin too": in_pymunk(scene, slop=0.005, skin=0.01)}
    ways |= {f"Box2D, {label}": in_box2d(scene, how) for label, how in CHANGED.items() if label != "no damping"}
    print(f"{title}\n    {'step':24}" + "".join(f"{k:9}" for k in steps))
    for label, states in ways.items():
        print(f"    {label:24}" + "".join(f"{states[k][name][which]:9.4f}" for k in steps))


def room(bodies, statics, seconds):
    steps = round(seconds * RATE)
    return {"format": "iplw.scene/1", "gravity": [0.0, -9.8], "time_step": 1 / RATE, "steps": steps, "observe_every": 1,
            "contact_rules": phyre_tasks.BOX2D_RULES, "bodies": [{"density": 0.25, **SURFACE, **own} for own in bodies],
            "statics": [{**SURFACE, **own} for own in statics]}


def box(half_width, half_height):
    return {"type": "box", "half_width": half_width, "half_height": half_height}


FLOOR = {"name": "floor", "shape": box(30.0, 0.5), "position": [0.0, -0.5]}


def drop():
    return room([{"name": "disc", "shape": {"type": "disc", "radius": 1.25}, "position": [0.0, 9.8]}], [FLOOR], 3)


def notch(other_way):
    bars = [{"name": "left", "shape": box(1.867, 0.427), "position": [-1.897, 0.0], "angle": -0.087},
            {"name": "right", "shape": box(1.867, 0.427), "position": [1.896, 0.0], "angle": 0.087}]
    discs = [{"name": "disc", "shape": {"type": "disc", "radius": 2.0833}, "position": [0.0, 2.3875]},
             {"name": "red", "shape": {"type": "disc", "radius": 5.0}, "position": [6.4333, 15.079]}]
    return room(discs, bars[::-1] if other_way else bars, 3)


def bar():
    own = {"name": "bar", "shape": box(0.427, 9.067), "position": [0.0, 9.067], "angular_velocity": 0.02,
           "velocity": [-0.18, 0.0]}
    return room([own], [FLOOR], 10)


def lanes(binary, scene):
    command = [binary, "rollout", "--engine", "lanes", "--threads", "1"]
    ran = subprocess.run(command, input=json.dumps(scene), capture_output=True, text=True)
    if ran.returncode != 0:
        raise SystemExit(ran.stderr.strip())
    bodies = json.loads(ran.stdout)["bodies"]
    return [{name: (own["x"][k], own["y"][k], own["angle"][k]) for name, own in bodies.items()}
            for k in range(scene["steps"] + 1)]


def in_pymunk(scene, slop=None, sweeps=10, skin=0.0):
    """Pymunk with Box2D's rules: coefficients whose products equal Box2D's, and no bounce below the threshold."""
    own = json.loads(json.dumps(scene))
    for thing in [*own["bodies"], *own["statics"]]:
        thing |= {key: math.sqrt(thing[key]) for key in SURFACE}
    space, bodies = pymunk_scene.build(own, slop)
    space.iterations = sweeps
    for shape in space.shapes:
        if isinstance(shape, pymunk.Poly):
            shape.unsafe_set_radius(skin)
    space.reindex_static()
    space.on_collision(None, None, pre_solve=threshold)
    states = []
    for _ in range(scene["steps"] + 1):
        states.append({thing["name"]: (*body.position, body.angle) for thing, body in zip(scene["bodies"], bodies)})
        space.step(1 / RATE)
    return states


def threshold(arbiter, _space, _data):
    one, other = (shape.body for shape in arbiter.shapes)
    fastest = 0.0
    for point in arbiter.contact_point_set.points:
        apart = other.velocity_at_world_point(point.point_b) - one.velocity_at_world_point(point.point_a)
        fastest = max(fastest, -apart.dot(arbiter.normal))
    arbiter.restitution = SURFACE["restitution"] if fastest > phyre_tasks.BOX2D_RULES["restitution_threshold"] else 0.0


def in_box2d(scene, how):
    world, things = box2d_scene.build(scene, how)
    at = lambda: {own["name"]: (*things[own["name"]].position, things[own["name"]].angle) for own in scene["bodies"]}
    states = [at(), at()]
    for _ in range(scene["steps"]):
        world.Step(1 / RATE, *how.iterations)
        states.append(at())
    return states


if __name__ == "__main__":
    main()
