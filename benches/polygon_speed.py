"""Speed of polygons: the batched engine, `rapier`, Pymunk and, if installed, Box2D on the same scenes, one core each.

    python benches/polygon_speed.py target/release/iplw [COPIES] [SCENE ...]

A scene is rolled out from COPIES (256) slightly different initial states, as in estimation and planning. Pymunk and Box2D are stepped
from Python, with states read once per second; ours are run from the command line, including JSON. Processor time; median
of three alternating rounds. Prints microseconds per rollout step and the speed of the batched engine relative to Pymunk.
"""

import argparse
import json
import math
import random
import resource
import statistics
import subprocess
import time

import pymunk_scene

STEP, SECONDS, SEEN = 1 / 240, 6, 240
ROUNDS = 3


def box(w, h, **at):
    return {"type": "box", "half_width": w, "half_height": h, **at}


def thing(name, shape, x, y, angle=0.0, **more):
    return {"name": name, "shape": shape, "density": 1.0, "friction": 0.7, "restitution": 0.2, "position": [x, y],
            "angle": angle, **more}


def room(bodies, *statics):
    fixed = lambda name, shape, **where: {"name": name, "shape": shape, "friction": 0.8, "restitution": 0.5, **where}
    walls = [fixed("floor", box(12, 0.5), position=[0, -0.5]), fixed("left", box(0.5, 8), position=[-10.5, 7]),
             fixed("right", box(0.5, 8), position=[10.5, 7])]
    return {"format": "iplw.scene/1", "gravity": [0.0, -9.8], "bodies": bodies, "statics": [*walls, *statics],
            "time_step": STEP, "steps": round(SECONDS / STEP), "observe_every": SEEN}


def ten_boxes(draw):
    return room([thing(f"b{i}", box(0.5, 0.5), draw.uniform(-0.02, 0.02), 0.5 + i) for i in range(10)])


def ten_boxes_fall(draw):
    return room([thing(f"b{i}", box(0.5, 0.4), -6 + 3 * (i % 5) + draw.uniform(-0.3, 0.3), 3 + 2 * (i // 5),
                       draw.uniform(-1, 1)) for i in range(10)])


def dominoes(draw):
    row = [thing(f"d{i}", box(0.08, 0.6), -3 + 0.6 * i, 0.6) for i in range(10)]
    return room([*row, thing("ball", {"type": "disc", "radius": 0.4}, -6, 0.4, velocity=[draw.uniform(3, 5), 0])])


def see_saw(draw):
    pivot = {"name": "pivot", "shape": {"type": "polygon", "vertices": [[-0.5, 0], [0.5, 0], [0, 1]]}, "friction": 1.0,
             "restitution": 0.2}
    return room([thing("plank", box(3, 0.1), 0, 1.1), thing("box", box(0.4, 0.4), -2.4, 1.6),
                 thing("ball", {"type": "disc", "radius": 0.5}, draw.uniform(1.5, 2.8), 5)], pivot)


def jar(draw):
    pieces = [box(1.0, 0.1), box(0.1, 0.8, position=[-0.9, 0.7]), box(0.1, 0.8, position=[0.9, 0.7])]
    return room([thing("jar", {"type": "compound", "pieces": pieces}, 0, 0.11),
                 *[thing(f"ball{i}", {"type": "disc", "radius": 0.3}, draw.uniform(-0.4, 0.4), 2 + i) for i in range(4)],
                 thing("bar", box(0.15, 1.0), 3, 1.0)])


def gravel(draw):
    def stone():
        n = draw.choice([5])
        angles = [2 * math.pi * (i + draw.uniform(-0.2, 0.2)) / n for i in range(n)]
        return {"type": "polygon", "vertices": [[0.5 * math.cos(a), 0.5 * math.sin(a)] for a in angles]}
    return room([thing(f"s{i}", stone(), -5 + 2 * (i % 6), 2 + 1.5 * (i // 6), draw.uniform(-3, 3)) for i in range(12)])


SCENES = {f.__name__: f for f in (ten_boxes, ten_boxes_fall, dominoes, see_saw, jar, gravel)}


def pymunk_run(scene):
    space, bodies = pymunk_scene.build(scene)
    for step in range(1, scene["steps"] + 1):
        space.step(STEP)
        if step % scene["observe_every"] == 0:
            [(*b.position, b.angle) for b in bodies]


def box2d_run(scene):
    import Box2D

    world = Box2D.b2World(gravity=tuple(scene["gravity"]), doSleep=False)

    def fixtures(body, own, surface):
        for piece in own.get("pieces", [own]):
            at, angle = piece.get("position", [0, 0]), piece.get("angle", 0)
            if piece["type"] == "disc":
                shape = Box2D.b2CircleShape(radius=piece["radius"], pos=at)
            elif piece["type"] == "box":
                shape = Box2D.b2PolygonShape(box=(piece["half_width"], piece["half_height"], at, angle))
            else:
                shape = Box2D.b2PolygonShape(vertices=piece["vertices"])
            body.CreateFixture(shape=shape, density=1.0, friction=surface["friction"], restitution=surface["restitution"])

    for own in scene["statics"]:
        fixtures(world.CreateStaticBody(position=own.get("position", [0, 0]), angle=own.get("angle", 0)), own["shape"], own)
    bodies = []
    for own in scene["bodies"]:
        body = world.CreateDynamicBody(position=own["position"], angle=own["angle"],
                                       linearVelocity=own.get("velocity", [0, 0]))
        fixtures(body, own["shape"], own)
        bodies.append(body)
    for step in range(1, scene["steps"] + 1):
        world.Step(STEP, 10, 10)
        if step % scene["observe_every"] == 0:
            [(*b.position, b.angle) for b in bodies]


def in_process(run):
    def seconds(scenes):
        start = time.process_time()
        for scene in scenes:
            run(scene)
        return time.process_time() - start
    return seconds


def by_command(binary, engine):
    def seconds(scenes):
        lines = "\n".join(map(json.dumps, scenes))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([binary, "rollout", "--engine", engine, "--threads", "1"], input=lines, text=True, check=True,
                       stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary")
    parser.add_argument("copies", nargs="?", type=int, default=256)
    parser.add_argument("scenes", nargs="*", choices=[[], *SCENES], default=[])
    given = parser.parse_args()
    engines = {"lanes": by_command(given.binary, "lanes"), "rapier": by_command(given.binary, "rapier"),
               "pymunk": in_process(pymunk_run)}
    try:
        import Box2D  # noqa: F401
        engines["box2d"] = in_process(box2d_run)
    except ImportError:
        pass
    print(f"{'scene':16}" + "".join(f"{name + ' us':>12}" for name in engines) + f"{'over pymunk':>14}")
    ratios = []
    for name in given.scenes or SCENES:
        draw = random.Random(name)
        scenes = [SCENES[name](draw) for _ in range(given.copies)]
        # The other engines are slow and their copies similar, so a quarter of the copies suffices.
        few = scenes[: max(1, given.copies // 4)]
        share = {engine: scenes if engine == "lanes" else few for engine in engines}
        taken = {engine: [] for engine in engines}
        for _ in range(ROUNDS):
            for engine, seconds in engines.items():
                taken[engine].append(1e6 * seconds(share[engine]) / sum(s["steps"] for s in share[engine]))
        us = {engine: statistics.median(values) for engine, values in taken.items()}
        ratios.append(us["pymunk"] / us["lanes"])
        print(f"{name:16}" + "".join(f"{value:12.3f}" for value in us.values()) + f"{ratios[-1]:13.1f}x", flush=True)
    print(f"geometric mean over Pymunk: {math.exp(statistics.mean(map(math.log, ratios))):.1f}x")


if __name__ == "__main__":
    main()
